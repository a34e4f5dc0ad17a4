"""Materials of furniture: finishes that each sample draws, and fixed ones of small parts."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from vig_world.assets.props.material import Material, material, metal
from vig_world.assets.textures import near, texture

_SIZE = 32
_STAND_INS = 12
"""Textures that stand in for a finish until a sample chooses one."""
_PAINTS = np.array(
    [
        [0.82, 0.81, 0.78],
        [0.70, 0.67, 0.60],
        [0.10, 0.11, 0.12],
        [0.16, 0.24, 0.20],
        [0.14, 0.19, 0.30],
        [0.45, 0.50, 0.48],
        [0.55, 0.28, 0.20],
        [0.62, 0.60, 0.42],
        [0.30, 0.32, 0.34],
    ],
    np.float32,
)


@lru_cache(maxsize=64)
def _stand_in(pattern: str, number: int) -> np.ndarray:
    return texture(pattern, np.random.default_rng(number), _SIZE)


def _slot(rng: np.random.Generator, slot: str, pattern: str, low: float, high: float) -> Material:
    image = _stand_in(pattern, int(rng.integers(_STAND_INS)))
    return Material(image, "cloth" if pattern == "cloth" else "wood", float(rng.uniform(low, high)), slot)


def wood(rng: np.random.Generator) -> Material:
    """The main surface of wooden furniture."""
    return _slot(rng, "wood", "wood", 0.35, 0.7)


def top(rng: np.random.Generator) -> Material:
    """What things stand on: a table's top, a worktop."""
    return _slot(rng, "top", "wood", 0.2, 0.6)


def fabric(rng: np.random.Generator) -> Material:
    """Covers of seats and beds."""
    return _slot(rng, "fabric", "cloth", 0.85, 1.0)


def fabric_own(rng: np.random.Generator) -> Material:
    """A loose cushion's or a rug's cloth, which stays what it is."""
    return material("cloth", rng, str(rng.choice(["cloth", "wallpaper", "cloth", "paint"])))


def plain(base: ArrayLike, kind: str = "plastic", roughness: float = 0.5) -> Material:
    """A surface of one colour."""
    return Material(np.asarray(base, np.float32).reshape(1, 1, 3), kind, roughness)


def paint(rng: np.random.Generator) -> Material:
    """Painted wood, of a colour that furniture has."""
    base = near(
        _PAINTS[rng.choice(len(_PAINTS), p=[0.3, 0.12, 0.1, 0.09, 0.09, 0.09, 0.06, 0.06, 0.09])], rng
    )
    return Material(texture("paint", rng, _SIZE, base), "wood", float(rng.uniform(0.3, 0.6)))


def carcass(rng: np.random.Generator, painted: float = 0.3) -> Material:
    """Wood of the sample's choice, or with the given chance paint."""
    return paint(rng) if rng.uniform() < painted else wood(rng)


def fitting(rng: np.random.Generator) -> Material:
    """Handles, taps, hinges, rails: metal or dark plastic."""
    return metal(rng) if rng.uniform() < 0.75 else plain((0.04, 0.04, 0.045))


def glow(colour: ArrayLike, emission: float) -> Material:
    """A lamp's shade or bulb, lit."""
    return Material(np.asarray(colour, np.float32).reshape(1, 1, 3), "paper", 0.9, "", emission)
