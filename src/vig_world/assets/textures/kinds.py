"""The kinds of textures: each maker registers itself, with the facts about its kind."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

from vig_world.assets.textures.fields import Array

Maker = TypeVar("Maker", bound=Callable[..., Array])


@dataclass(frozen=True)
class TextureKind:
    """A kind of texture.

    Attributes:
        make: Function of (generator, size in pixels, base albedo (3,) or None) to an image (size, size, 3).
        metres: Plausible metres per repeat: lowest, highest.
        needs_base: Whether `make` cannot choose a base albedo itself.
        periodic: Whether the texture tiles in both directions.
    """

    make: Callable[..., Array]
    metres: tuple[float, float]
    needs_base: bool
    periodic: bool


KINDS: dict[str, TextureKind] = {}  # every kind of texture by name


def kind(
    metres: tuple[float, float], needs_base: bool = False, periodic: bool = True
) -> Callable[[Maker], Maker]:
    """Register the decorated function as the maker of a kind, named like the function; see `TextureKind`."""

    def register(make: Maker) -> Maker:
        KINDS[make.__name__.rstrip("_")] = TextureKind(make, metres, needs_base, periodic)
        return make

    return register
