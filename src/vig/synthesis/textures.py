"""Procedural albedo textures: linear RGB, periodic in both directions (all but `print`, a label)."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = np.ndarray

DARKEST, BRIGHTEST = 0.02, 0.95
_WOODS = np.array(
    [[0.55, 0.33, 0.16], [0.32, 0.16, 0.07], [0.70, 0.52, 0.32], [0.14, 0.07, 0.035], [0.45, 0.20, 0.09],
     [0.62, 0.55, 0.45]],
    np.float32,
)  # fmt: skip
_BRICKS = np.array(
    [[0.42, 0.14, 0.08], [0.55, 0.30, 0.18], [0.60, 0.57, 0.52], [0.25, 0.12, 0.09]], np.float32
)


def colour(rng: np.random.Generator) -> Array:
    """One random albedo (3,), linear RGB in [0.02, 0.95], as household things have them.

    A third are greys from black to white with a slight tint, a third uniform in [0.2, 0.8] per channel (the
    range an explained object's own albedo has, so that props can look like it), a third saturated pigments.
    """
    choice = rng.uniform()
    if choice < 0.35:
        rgb = rng.uniform(0.15, 0.97) ** 2 * (1 + rng.uniform(-0.12, 0.12, 3))
    elif choice < 0.65:
        rgb = rng.uniform(0.2, 0.8, 3)
    else:
        hue = np.clip(np.abs((rng.uniform() * 6 + np.array([0, 4, 2])) % 6 - 3) - 1, 0, 1)
        rgb = rng.uniform(0.1, 0.9) * (1 - rng.uniform(0.5, 0.98) * (1 - hue))
    return np.clip(rgb, DARKEST, BRIGHTEST).astype(np.float32)


def near(base: ArrayLike, rng: np.random.Generator, spread: float = 0.15) -> Array:
    """A colour (3,) close to `base` (3,): brightness and, half as much, tint scaled by up to 1 +- spread."""
    factor = 1 + rng.uniform(-spread, spread) + 0.5 * rng.uniform(-spread, spread, 3)
    return np.clip(np.asarray(base) * factor, DARKEST, BRIGHTEST).astype(np.float32)


@lru_cache(maxsize=64)
def _filter(size: int, slope: float, stretch: float, cutoff: float) -> Array:
    fy = np.fft.fftfreq(size)[:, None] * size * stretch
    fx = np.fft.rfftfreq(size)[None, :] * size
    f = np.hypot(fy, fx)
    f[0, 0] = np.inf
    return (np.maximum(f, cutoff) ** -slope * np.isfinite(f)).astype(np.float32)


def noise(
    rng: np.random.Generator, size: int, slope: float = 1.5, stretch: float = 1.0, cutoff: float = 1.0
) -> Array:
    """Periodic Gaussian noise (size, size) of mean 0 and deviation 1.

    Amplitude falls as frequency^-slope above `cutoff` cycles; `stretch` > 1 draws the grain out along rows'
    direction v.
    """
    spectrum = np.fft.rfft2(rng.standard_normal((size, size), np.float32)) * _filter(
        size, slope, stretch, cutoff
    )
    field = np.fft.irfft2(spectrum, (size, size)).astype(np.float32)
    return field / field.std()


@lru_cache(maxsize=8)
def _grid(size: int) -> tuple[Array, Array]:
    """Texture coordinates (size, 1) down and (1, size) right, pixel centres in (0, 1)."""
    t = ((np.arange(size) + 0.5) / size).astype(np.float32)
    return t[:, None], t[None, :]


def _mix(a: Array, b: Array, weight: Array) -> Array:
    """Colours a where weight (size, size) is 0, b where it is 1."""
    return a + (b - a) * weight[..., None]


def _cells(
    rng: np.random.Generator, size: int, rows: int, columns: int, shift: float, joint: float
) -> tuple[Array, NDArray[np.bool_]]:
    """A random number in [-1, 1] per cell of a (running-bond) grid, and where the joints are."""
    v, u = _grid(size)
    row = np.floor(v * rows).astype(int)
    x = u * columns + shift * row
    column = np.floor(x).astype(int) % columns
    value = rng.uniform(-1, 1, (rows, columns)).astype(np.float32)[row, column]
    gap_v, gap_u = joint * rows, joint * columns
    return value, ((v * rows) % 1 < gap_v) | (x % 1 < gap_u)


def _paint(rng: np.random.Generator, size: int, base: Array) -> Array:
    return base * (1 + rng.uniform(0.01, 0.05) * noise(rng, size, 1.6))[..., None]


def _wood(rng: np.random.Generator, size: int, base: Array | None) -> Array:
    v, u = _grid(size)
    tone = near(_WOODS[rng.integers(len(_WOODS))], rng, 0.25) if base is None else base
    planks = int(rng.choice([1, 1, 2, 3, 4, 6]))
    plank = np.floor(u * planks).astype(int)
    warp = noise(rng, size, 2.0, stretch=6.0)
    phase = rng.uniform(0, 9, planks).astype(np.float32)[plank]
    rings = np.sin(2 * np.pi * (rng.integers(3, 9) * u + 0.35 * warp + phase))
    pores = noise(rng, size, 0.5, stretch=16.0)
    shade = 1 + rng.uniform(0.06, 0.2) * rings + 0.07 * pores
    if planks > 1:
        shade = shade * (1 + rng.uniform(0.05, 0.25) * rng.uniform(-1, 1, planks).astype(np.float32)[plank])
        shade = np.where((u * planks) % 1 < 1.2 * planks / size, 0.35 * shade, shade)
        butt = (v - rng.uniform(0, 1, planks).astype(np.float32)[plank]) % 1 < 1.2 / size
        shade = np.where(butt, 0.4 * shade, shade)
    return tone * np.maximum(shade, 0.15)[..., None]


def _tiles(rng: np.random.Generator, size: int, base: Array) -> Array:
    n = int(rng.integers(2, 7))
    value, joint = _cells(rng, size, n, n, 0.0, rng.uniform(0.008, 0.02))
    shade = 1 + rng.uniform(0.0, 0.12) * value + rng.uniform(0.0, 0.05) * noise(rng, size)
    grout = rng.uniform(0.1, 0.8) * np.ones(3, np.float32)
    return _mix(base * shade[..., None], grout, joint.astype(np.float32))


def _brick(rng: np.random.Generator, size: int, base: Array | None) -> Array:
    clay = near(_BRICKS[rng.integers(len(_BRICKS))], rng, 0.25) if base is None else base
    rows = 2 * int(rng.integers(3, 7))
    value, joint = _cells(rng, size, rows, rows // 2, 0.5, rng.uniform(0.012, 0.022))
    shade = 1 + rng.uniform(0.1, 0.35) * value + 0.1 * noise(rng, size, 0.8)
    mortar = rng.uniform(0.25, 0.7) * np.array([1, 0.96, 0.9], np.float32)
    return _mix(clay * shade[..., None], mortar * (1 + 0.05 * noise(rng, size))[..., None],
                joint.astype(np.float32))  # fmt: skip


def _marble(rng: np.random.Generator, size: int, base: Array | None) -> Array:
    if base is None:
        base = near(np.full(3, rng.choice([0.08, 0.4, 0.75, 0.8]), np.float32), rng, 0.15)
    vein = near(np.full(3, 0.75 if base.mean() < 0.25 else 0.2), rng, 0.3)
    field = noise(rng, size, 1.9) + 0.15 * noise(rng, size, 1.0)
    weight = np.exp(-np.abs(field) / rng.uniform(0.03, 0.12)) * np.clip(
        0.5 + 0.5 * noise(rng, size, 2.0), 0, 1
    )
    return _mix(base * (1 + 0.08 * noise(rng, size))[..., None], vein, np.clip(weight * 0.9, 0, 1))


def _cloth(rng: np.random.Generator, size: int, base: Array) -> Array:
    v, u = _grid(size)
    second = colour(rng)
    threads = max(1, size // int(rng.choice([4, 6, 8])))
    style = rng.integers(3)
    bands = np.repeat(rng.uniform(size=8) < 0.4, size // 8 + 1)[:size].astype(np.float32)
    if style == 0:
        weight = np.zeros((size, size), np.float32)
    elif style == 1:
        weight = np.broadcast_to(bands[None, :], (size, size))
    else:
        weight = 0.5 * (bands[None, :] + bands[:, None])
    weave = np.sin(np.pi * 2 * threads * u) * np.sin(np.pi * 2 * threads * v)
    shade = 1 + rng.uniform(0.05, 0.25) * weave + 0.06 * noise(rng, size, 0.6)
    return _mix(base, second, weight) * shade[..., None]


def _wallpaper(rng: np.random.Generator, size: int, base: Array) -> Array:
    v, u = _grid(size)
    second = near(base, rng, 0.5) if rng.uniform() < 0.6 else colour(rng)
    n = int(rng.integers(3, 11))
    stripe = (np.cos(2 * np.pi * n * u) > rng.uniform(-0.6, 0.8)) * np.ones_like(v)
    if rng.uniform() < 0.4:  # a repeated motif instead of plain stripes
        rows = int(rng.integers(3, 9))
        x = (u * rows + 0.5 * (np.floor(v * rows) % 2)) % 1 - 0.5 if rows % 2 == 0 else (u * rows) % 1 - 0.5
        y = (v * rows) % 1 - 0.5
        radius = rng.uniform(0.15, 0.4) * (1 + 0.4 * np.cos(rng.integers(3, 7) * np.arctan2(y, x)))
        stripe = np.hypot(x, y) < radius
    return _mix(base, second, stripe.astype(np.float32)) * (1 + 0.02 * noise(rng, size))[..., None]


def _print(rng: np.random.Generator, size: int, base: Array) -> Array:
    image = np.empty((size, size, 3), np.float32)
    image[:] = base

    def rectangle(top: float, bottom: float, left: float, right: float, fill: Array) -> None:
        rows, columns = np.round(np.array([[top, bottom], [left, right]]) * size).astype(int)
        image[rows[0] : rows[1], columns[0] : columns[1]] = fill

    for _ in range(rng.integers(1, 4)):  # blocks of colour, from edge to edge or inset
        top, height = rng.uniform(0, 0.7), rng.uniform(0.1, 0.45)
        left = rng.choice([0.0, rng.uniform(0, 0.4)])
        rectangle(top, min(top + height, 1), left, 1 - left, colour(rng))
    if rng.uniform() < 0.5:  # a round emblem
        v, u = _grid(size)
        inside = np.hypot(u - rng.uniform(0.35, 0.65), v - rng.uniform(0.25, 0.6)) < rng.uniform(0.1, 0.25)
        image[inside] = colour(rng)
    ink = np.full(3, 0.03 if base.mean() > 0.3 else 0.85, np.float32)
    title = rng.uniform(0.08, 0.3)
    x = 0.12
    while x < 0.8:  # a title of letter-like strokes
        width = rng.uniform(0.03, 0.09)
        rectangle(title, title + 0.1, x, min(x + width, 0.88), ink)
        if rng.uniform() < 0.6:
            rectangle(title + 0.03, title + 0.07, x + 0.012, min(x + width, 0.88) - 0.012, base)
        x += width + 0.025
    line, step = rng.uniform(0.5, 0.7), rng.uniform(0.035, 0.06)
    while line < 0.92:  # small print
        rectangle(line, line + 0.45 * step, 0.12, rng.uniform(0.5, 0.88), ink)
        line += step
    return image


def _checker(rng: np.random.Generator, size: int, base: Array) -> Array:
    v, u = _grid(size)
    n = int(rng.integers(1, 7))
    odd = (np.floor(2 * n * u) + np.floor(2 * n * v)) % 2
    return _mix(base, colour(rng), odd) * (1 + 0.03 * noise(rng, size))[..., None]


def _terrazzo(rng: np.random.Generator, size: int, base: Array) -> Array:
    image = base * (1 + 0.03 * noise(rng, size))[..., None]
    for _ in range(rng.integers(2, 5)):  # each kind of chip: the peaks of its own band of noise
        band = noise(rng, size, 3.0, cutoff=round(rng.uniform(6, 16)))
        image = _mix(image, colour(rng), (band > rng.uniform(1.2, 1.9)).astype(np.float32))
    return image


def _speckle(rng: np.random.Generator, size: int, base: Array) -> Array:
    grain = noise(rng, size, round(rng.uniform(0.3, 0.9), 1))
    return _mix(base, near(base, rng, 0.6), np.clip(0.5 + rng.uniform(0.2, 0.6) * grain, 0, 1))


_MAKERS: dict[str, Callable[..., Array]] = {
    "paint": _paint,
    "wood": _wood,
    "tiles": _tiles,
    "brick": _brick,
    "marble": _marble,
    "cloth": _cloth,
    "wallpaper": _wallpaper,
    "print": _print,
    "checker": _checker,
    "terrazzo": _terrazzo,
    "speckle": _speckle,
}
KINDS = tuple(_MAKERS)
_OWN_COLOUR = ("wood", "brick", "marble")


def texture(kind: str, rng: np.random.Generator, size: int = 128, base: ArrayLike | None = None) -> Array:
    """Draws one random texture of a kind.

    Args:
        kind: one of `KINDS`.
        rng: everything random comes from it.
        size: width and height in pixels, at least 8.
        base: main albedo (3,), linear RGB; None draws one fit for the kind.

    Returns:
        (size, size, 3) float32 linear albedo in [0.02, 0.95]; row 0 is the top.

    Raises:
        ValueError: an unknown kind or a size below 8.
    """
    if kind not in _MAKERS:
        raise ValueError(f"kind must be one of {', '.join(KINDS)}; got {kind!r}.")
    if size < 8:
        raise ValueError(f"size must be at least 8 pixels; got {size}.")
    if base is not None:
        base = np.asarray(base, np.float32)
    elif kind not in _OWN_COLOUR:
        base = colour(rng)
    image = _MAKERS[kind](rng, size, base)
    return np.clip(image, DARKEST, BRIGHTEST).astype(np.float32)
