"""Albedos of household things: mostly white, wood, grey, earth and dark, some muted colours, few accents."""

import numpy as np
from numpy.typing import ArrayLike

Array = np.ndarray

DARKEST, BRIGHTEST = 0.02, 0.95

_NEUTRAL = np.array(
    [[0.80, 0.79, 0.76], [0.80, 0.79, 0.76], [0.76, 0.70, 0.58], [0.52, 0.52, 0.52], [0.30, 0.29, 0.28],
     [0.14, 0.14, 0.15], [0.05, 0.05, 0.055], [0.56, 0.45, 0.32], [0.34, 0.25, 0.17], [0.15, 0.08, 0.045]],
    np.float32,
)  # fmt: skip
_MUTED = np.array(
    [[0.42, 0.17, 0.09], [0.52, 0.34, 0.09], [0.20, 0.22, 0.09], [0.27, 0.35, 0.25], [0.17, 0.25, 0.33],
     [0.04, 0.07, 0.16], [0.56, 0.36, 0.31], [0.25, 0.42, 0.46], [0.26, 0.06, 0.06], [0.60, 0.55, 0.38],
     [0.12, 0.20, 0.14], [0.36, 0.30, 0.38]],
    np.float32,
)  # fmt: skip
_VIVID = np.array(
    [[0.60, 0.04, 0.03], [0.70, 0.20, 0.02], [0.80, 0.52, 0.03], [0.04, 0.14, 0.50], [0.06, 0.30, 0.10],
     [0.03, 0.30, 0.42], [0.50, 0.06, 0.18]],
    np.float32,
)  # fmt: skip
_VIVID_ODDS = np.array([0.25, 0.15, 0.2, 0.15, 0.12, 0.08, 0.05])

_LMS = np.array([[0.4122, 0.5363, 0.0514], [0.2119, 0.6807, 0.1074], [0.0883, 0.2817, 0.6300]])
_LAB = np.array([[0.2105, 0.7936, -0.0041], [1.9780, -2.4286, 0.4506], [0.0259, 0.7828, -0.8087]])
_LMS_BACK, _LAB_BACK = np.linalg.inv(_LMS), np.linalg.inv(_LAB)


def colour(rng: np.random.Generator) -> Array:
    """Return one random albedo (3,), linear RGB in [0.02, 0.95], as household things have them.

    A quarter are uniform in [0.2, 0.8] per channel (the range an explained object's own albedo has, so that
    props can look like it), two fifths whites, greys, woods and blacks, a quarter muted, a tenth pigments.
    """
    choice = rng.uniform()
    if choice < 0.25:
        return rng.uniform(0.2, 0.8, 3).astype(np.float32)
    if choice < 0.65:
        return neutral(rng)
    if choice < 0.9:
        return near(_MUTED[rng.integers(len(_MUTED))], rng, 0.3)
    return near(_VIVID[rng.choice(len(_VIVID), p=_VIVID_ODDS)], rng, 0.25)


def neutral(rng: np.random.Generator) -> Array:
    """Return one albedo (3,) of the whites, greys, beiges, browns and blacks."""
    return shade(_NEUTRAL[rng.integers(len(_NEUTRAL))], rng, 0.22)


def accent(rng: np.random.Generator) -> Array:
    """Return one albedo (3,) with a hue: muted mostly, vivid now and then."""
    if rng.uniform() < 0.65:
        return near(_MUTED[rng.integers(len(_MUTED))], rng, 0.25)
    return near(_VIVID[rng.choice(len(_VIVID), p=_VIVID_ODDS)], rng, 0.25)


def near(base: ArrayLike, rng: np.random.Generator, spread: float = 0.15) -> Array:
    """Return a colour (3,) like `base` (3,): brightness, half as much tint, scaled by up to 1 +- spread."""
    factor = 1 + rng.uniform(-spread, spread) + 0.5 * rng.uniform(-spread, spread, 3)
    return np.clip(np.asarray(base) * factor, DARKEST, BRIGHTEST).astype(np.float32)


def shade(base: ArrayLike, rng: np.random.Generator, spread: float = 0.2) -> Array:
    """Return a colour (3,) like `base` (3,), brighter or darker by up to 1 +- spread, nearly of its tint."""
    factor = (1 + rng.uniform(-spread, spread)) * (1 + rng.uniform(-0.025, 0.025, 3))
    return np.clip(np.asarray(base) * factor, DARKEST, BRIGHTEST).astype(np.float32)


def partner(base: ArrayLike, rng: np.random.Generator) -> Array:
    """Return a colour (3,) that goes with `base` (3,): of another lightness, and of the same, a near or the
    opposite hue.

    Chosen in the perceptual space Oklab; always distinguishable from `base`.
    """
    light, a, b = _LAB @ np.cbrt(_LMS @ np.asarray(base, np.float64))
    chroma, hue = np.hypot(a, b), np.arctan2(b, a)
    if chroma < 0.03:
        hue = rng.normal(0.9, 0.9) if rng.uniform() < 0.7 else rng.normal(-2.2, 0.6)  # warm, or blue
    choice = rng.uniform()
    if choice < 0.4:  # near white or near black
        light = rng.uniform(0.86, 0.95) if light < 0.62 else rng.uniform(0.22, 0.4)
        chroma = rng.uniform(0, 0.025)
    elif choice < 0.7:  # the same hue
        light += rng.uniform(0.16, 0.35) * (1 if light < 0.55 else -1)
        chroma = min(max(chroma, 0.03) * rng.uniform(0.6, 1.3), 0.15)
    else:  # a neighbour, or now and then the opposite
        hue += rng.uniform(0.4, 1.0) * rng.choice([-1, 1]) + (np.pi if choice > 0.9 else 0)
        light = np.clip(light + rng.uniform(0.1, 0.3) * rng.choice([-1, 1]), 0.3, 0.9)
        chroma = rng.uniform(0.05, 0.13)
    rgb = _LMS_BACK @ (_LAB_BACK @ [light, chroma * np.cos(hue), chroma * np.sin(hue)]) ** 3
    return np.clip(rgb, DARKEST, BRIGHTEST).astype(np.float32)
