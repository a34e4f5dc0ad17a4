"""Procedural albedo textures: linear RGB, periodic in both directions, all but printed matter."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from vig_world.assets.textures import fabric, prints, stone, timber
from vig_world.assets.textures.colours import (
    BRIGHTEST,
    DARKEST,
    accent,
    colour,
    near,
    neutral,
    partner,
    shade,
)
from vig_world.assets.textures.decoration import decoration
from vig_world.assets.textures.fields import Array, noise

_MAKERS: dict[str, Callable[..., Array]] = {
    "paint": stone.paint,
    "wood": timber.wood,
    "tiles": stone.tiles,
    "brick": stone.brick,
    "marble": stone.marble,
    "cloth": fabric.cloth,
    "wallpaper": fabric.wallpaper,
    "print": prints.print_,
    "checker": fabric.checker,
    "terrazzo": stone.terrazzo,
    "speckle": stone.speckle,
    "plaster": stone.plaster,
    "concrete": stone.concrete,
    "granite": stone.granite,
    "linoleum": stone.linoleum,
    "cork": stone.cork,
    "parquet": timber.parquet,
    "herringbone": timber.herringbone,
    "stripes": fabric.stripes,
    "weave": fabric.weave,
    "leather": fabric.leather,
    "floral": fabric.floral,
    "page": prints.page,
    "news": prints.news,
    "picture": prints.picture,
}
KINDS = tuple(_MAKERS)
NOT_PERIODIC = ("print", "page", "news", "picture")
_NEEDS_COLOUR = ("paint", "tiles", "cloth", "wallpaper", "checker", "speckle", "stripes")

FINISHES: dict[str, tuple[str, ...]] = {
    "wall": (
        "paint",
        "paint",
        "paint",
        "plaster",
        "plaster",
        "wallpaper",
        "wallpaper",
        "floral",
        "brick",
        "tiles",
        "wood",
        "concrete",
        "stripes",
    ),
    "floor": (
        "wood",
        "wood",
        "wood",
        "parquet",
        "herringbone",
        "tiles",
        "tiles",
        "linoleum",
        "cloth",
        "concrete",
        "terrazzo",
        "marble",
        "checker",
        "cork",
    ),
    "ceiling": ("paint", "paint", "plaster", "plaster", "wood"),
    "wood": ("wood", "wood", "wood", "wood", "wood", "paint", "paint"),
    "top": (
        "wood",
        "wood",
        "wood",
        "wood",
        "paint",
        "marble",
        "granite",
        "granite",
        "terrazzo",
        "concrete",
        "tiles",
        "linoleum",
        "cloth",
    ),
    "fabric": ("cloth", "cloth", "cloth", "paint", "stripes", "floral", "leather", "speckle", "weave"),
}
"""Kinds of texture that suit each slot of `props.Material`; a kind that is named twice is twice as common."""

METRES: dict[str, tuple[float, float]] = {
    "paint": (0.6, 1.5), "wood": (0.3, 1.0), "tiles": (0.5, 1.2), "brick": (0.7, 1.2), "marble": (0.5, 1.2),
    "cloth": (0.15, 0.5), "wallpaper": (0.4, 1.0), "print": (0.2, 0.4), "checker": (0.3, 1.0),
    "terrazzo": (0.3, 0.7), "speckle": (0.2, 0.6), "plaster": (0.6, 1.5), "concrete": (0.8, 1.6),
    "granite": (0.25, 0.5), "linoleum": (0.4, 1.0), "cork": (0.3, 0.6), "parquet": (0.4, 0.9),
    "herringbone": (0.6, 1.2), "stripes": (0.3, 0.8), "weave": (0.1, 0.25), "leather": (0.2, 0.4),
    "floral": (0.4, 0.9), "page": (0.2, 0.3),
    "news": (0.3, 0.5), "picture": (0.2, 0.5),
}  # fmt: skip
"""Plausible metres per repeat of each kind: lowest, highest."""


def texture(kind: str, rng: np.random.Generator, size: int = 128, base: ArrayLike | None = None) -> Array:
    """Draws one random texture of a kind.

    Args:
        kind: one of `KINDS`.
        rng: everything random comes from it.
        size: width and height in pixels, at least 8.
        base: main albedo (3,), linear RGB; None draws one fit for the kind.

    Returns:
        (size, size, 3) float32 linear albedo in [0.02, 0.95]; row 0 is the top. It tiles in both directions,
        unless its kind is one of `NOT_PERIODIC`.

    Raises:
        ValueError: an unknown kind or a size below 8.
    """
    if kind not in _MAKERS:
        raise ValueError(f"kind must be one of {', '.join(KINDS)}; got {kind!r}.")
    if size < 8:
        raise ValueError(f"size must be at least 8 pixels; got {size}.")
    if base is not None:
        base = np.asarray(base, np.float32)
    elif kind in _NEEDS_COLOUR:
        base = colour(rng)
    image = _MAKERS[kind](rng, size, base)
    return np.clip(image, DARKEST, BRIGHTEST).astype(np.float32)


__all__ = [
    "FINISHES",
    "KINDS",
    "METRES",
    "NOT_PERIODIC",
    "Array",
    "accent",
    "colour",
    "decoration",
    "near",
    "neutral",
    "noise",
    "partner",
    "shade",
    "texture",
]
