"""Materials with procedural textures: fixed ones, and finishes that each sample draws anew."""

from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from vig_world.assets.textures import near, texture
from vig_world.assets.things import Material

ROUGHNESS = {
    "ceramic": (0.08, 0.4),
    "glass": (0.03, 0.15),
    "metal": (0.15, 0.5),
    "wood": (0.4, 0.8),
    "paper": (0.5, 0.9),
    "plastic": (0.2, 0.6),
    "cloth": (0.85, 1.0),
    "leaf": (0.4, 0.7),
    "skin": (0.3, 0.7),
    "wax": (0.4, 0.7),
    "earth": (0.9, 1.0),
}
"""Range of the roughness by kind of material."""
STAND_INS = {
    "wood": ("wood", "wood", (0.35, 0.7)),
    "top": ("wood", "wood", (0.2, 0.6)),
    "fabric": ("cloth", "cloth", (0.85, 1.0)),
}
"""Texture, kind of material and range of the roughness of furniture's slots, until a sample chooses."""
_STAND_IN_COUNT, _SIZE = 12, 32
_METALS = np.array([[0.56, 0.56, 0.56], [0.42, 0.42, 0.42], [0.58, 0.43, 0.20], [0.20, 0.20, 0.21]])
_PAINTS = np.array(
    [[0.82, 0.81, 0.78], [0.70, 0.67, 0.60], [0.10, 0.11, 0.12], [0.16, 0.24, 0.20], [0.14, 0.19, 0.30],
     [0.45, 0.50, 0.48], [0.55, 0.28, 0.20], [0.62, 0.60, 0.42], [0.30, 0.32, 0.34]],
)  # fmt: skip


def material(
    kind: str, rng: np.random.Generator, pattern: str = "paint", base: ArrayLike | None = None, size: int = 64
) -> Material:
    """Return a material with a texture of kind `pattern` (`textures.KINDS`), main colour `base` if given."""
    return Material(texture(pattern, rng, size, base), kind, float(rng.uniform(*ROUGHNESS[kind])))


def plain(base: ArrayLike, kind: str = "plastic", roughness: float = 0.5, emission: float = 0.0) -> Material:
    """Return a surface of one colour (3,), linear; it glows with a positive `emission`."""
    return Material(np.asarray(base, np.float32).reshape(1, 1, 3), kind, roughness, "", emission)


@lru_cache(maxsize=64)
def _stand_in(pattern: str, number: int) -> np.ndarray:
    return texture(pattern, np.random.default_rng(number), _SIZE)


def slot_material(slot: str, rng: np.random.Generator) -> Material:
    """Return the stand-in for a slot of furniture (of `STAND_INS`): wood, a top to stand on, or fabric."""
    pattern, kind, roughness = STAND_INS[slot]
    image = _stand_in(pattern, int(rng.integers(_STAND_IN_COUNT)))
    return Material(image, kind, float(rng.uniform(*roughness)), slot)


def loose_fabric(rng: np.random.Generator) -> Material:
    """Return a rug's or curtain's cloth, which keeps its finish."""
    return material("cloth", rng, str(rng.choice(["cloth", "wallpaper", "cloth", "paint"])))


def paint_finish(rng: np.random.Generator) -> Material:
    """Return painted wood, of a colour that furniture has."""
    chosen = _PAINTS[rng.choice(len(_PAINTS), p=[0.3, 0.12, 0.1, 0.09, 0.09, 0.09, 0.06, 0.06, 0.09])]
    return Material(texture("paint", rng, _SIZE, near(chosen, rng)), "wood", float(rng.uniform(0.3, 0.6)))


def fitting(rng: np.random.Generator) -> Material:
    """Return handles, hinges, rails: steel, brass, black iron or dark plastic."""
    if rng.uniform() < 0.25:
        return plain((0.04, 0.04, 0.045))
    return material("metal", rng, "paint", near(_METALS[rng.integers(len(_METALS))], rng, 0.08), 16)
