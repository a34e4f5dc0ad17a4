"""Procedural albedo textures: linear RGB, periodic in both directions, all but printed matter."""

import importlib
import pkgutil

import numpy as np
from numpy.typing import ArrayLike

from vig_world.assets.textures.colours import BRIGHTEST, DARKEST
from vig_world.assets.textures.colours import accent as accent
from vig_world.assets.textures.colours import colour as colour
from vig_world.assets.textures.colours import near as near
from vig_world.assets.textures.colours import neutral as neutral
from vig_world.assets.textures.colours import partner as partner
from vig_world.assets.textures.colours import shade as shade
from vig_world.assets.textures.decoration import decoration as decoration
from vig_world.assets.textures.fields import Array as Array
from vig_world.assets.textures.fields import noise as noise
from vig_world.assets.textures.kinds import KINDS as KINDS

for module in pkgutil.iter_modules(__path__):  # each maker registers itself in KINDS
    importlib.import_module(f"{__name__}.{module.name}")
for name in sorted(KINDS):  # so that their order depends neither on files nor on who imported them first
    KINDS[name] = KINDS.pop(name)


_FINISHES = {
    "wall": "paint paint paint plaster plaster wallpaper wallpaper floral brick tiles wood concrete stripes",
    "floor": (
        "wood wood wood parquet herringbone tiles tiles linoleum cloth concrete terrazzo marble checker cork"
    ),
    "ceiling": "paint paint plaster plaster wood",
    "wood": "wood wood wood wood wood paint paint",
    "top": "wood wood wood wood paint marble granite granite terrazzo concrete tiles linoleum cloth",
    "fabric": "cloth cloth cloth paint stripes floral leather speckle weave",
}
FINISHES: dict[str, tuple[str, ...]] = {slot: tuple(kinds.split()) for slot, kinds in _FINISHES.items()}
"""Kinds of texture for each slot of `things.Material`; one that stands twice is drawn twice as often."""


def texture(kind: str, rng: np.random.Generator, size: int = 128, base: ArrayLike | None = None) -> Array:
    """Draw one random texture of a kind.

    Args:
        kind: One of `KINDS`.
        rng: Source of all randomness.
        size: Width and height in pixels, at least 8.
        base: Main albedo (3,), linear RGB; None draws one that suits the kind.

    Returns:
        (size, size, 3) float32 linear albedo in [0.02, 0.95]; row 0 is the top. It tiles in both directions
        if its kind is periodic.

    Raises:
        ValueError: For an unknown kind or a size below 8.
    """
    if kind not in KINDS:
        raise ValueError(f"kind must be one of {', '.join(KINDS)}; got {kind!r}.")
    if size < 8:
        raise ValueError(f"size must be at least 8 pixels; got {size}.")
    if base is not None:
        base = np.asarray(base, np.float32)
    elif KINDS[kind].needs_base:
        base = colour(rng)
    image = KINDS[kind].make(rng, size, base)
    return np.clip(image, DARKEST, BRIGHTEST).astype(np.float32)
