"""Building blocks of textures: periodic noise, coordinates, cells, soft shapes."""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

Array = np.ndarray


@lru_cache(maxsize=128)
def _filter(size: int, slope: float, stretch: float, cutoff: float) -> Array:
    fy = np.fft.fftfreq(size)[:, None] * size * stretch
    fx = np.fft.rfftfreq(size)[None, :] * size
    f = np.hypot(fy, fx)
    f[0, 0] = np.inf
    return (np.maximum(f, cutoff) ** -slope * np.isfinite(f)).astype(np.float32)


def noise(
    rng: np.random.Generator, size: int, slope: float = 1.5, stretch: float = 1.0, cutoff: float = 1.0
) -> Array:
    """Return periodic Gaussian noise (size, size) of mean 0 and deviation 1.

    Amplitude falls as frequency^-slope above `cutoff` cycles; `stretch` > 1 draws the grain out along v.
    """
    spectrum = np.fft.rfft2(rng.standard_normal((size, size), np.float32)) * _filter(
        size, slope, stretch, cutoff
    )
    field = np.fft.irfft2(spectrum, (size, size)).astype(np.float32)
    return field / field.std()


@lru_cache(maxsize=16)
def grid(size: int) -> tuple[Array, Array]:
    """Return texture coordinates (size, 1) down and (1, size) right, pixel centres in (0, 1)."""
    t = ((np.arange(size) + 0.5) / size).astype(np.float32)
    return t[:, None], t[None, :]


def mix(a: Array, b: Array, weight: Array) -> Array:
    """Return colours a where weight (H, W) is 0, b where it is 1."""
    return a + (b - a) * weight[..., None]


def cells(
    rng: np.random.Generator, size: int, rows: int, columns: int, shift: float, joint: float
) -> tuple[Array, NDArray[np.bool_]]:
    """Return a random number in [-1, 1] per cell of a (running-bond) grid, and where the joints are."""
    v, u = grid(size)
    row = np.floor(v * rows).astype(int)
    x = u * columns + shift * row
    column = np.floor(x).astype(int) % columns
    value = rng.uniform(-1, 1, (rows, columns)).astype(np.float32)[row, column]
    gap_v, gap_u = joint * rows, joint * columns
    return value, ((v * rows) % 1 < gap_v) | (x % 1 < gap_u)


def ellipse(
    x: Array, y: Array, centre: tuple[float, float], radii: tuple[float, float], angle: float = 0.0
) -> Array:
    """Return an ellipse's coverage at points x, y (broadcast), its edge soft over a tenth of its radius."""
    dx, dy = x - centre[0], y - centre[1]
    c, s = np.cos(angle), np.sin(angle)
    distance = np.sqrt(((c * dx + s * dy) / radii[0]) ** 2 + ((c * dy - s * dx) / radii[1]) ** 2)
    return np.clip((1.05 - distance) * 10, 0, 1)


def blossom(
    size: int, rng: np.random.Generator, petals: int, leaves: int
) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]:
    """Return coverages (size, size) of a flower's leaves, petals and heart, upright, filling the square."""
    v, u = grid(size)
    middle, reach = (0.5, rng.uniform(0.3, 0.42)), rng.uniform(0.1, 0.13)
    angles = 2 * np.pi * np.arange(petals) / petals + rng.uniform(0, 2)
    slim = rng.uniform(0.55, 0.95)
    shape = np.zeros((size, size), np.float32)
    for angle in angles:
        centre = (middle[0] + 1.25 * reach * np.cos(angle), middle[1] + 1.25 * reach * np.sin(angle))
        np.maximum(shape, ellipse(u, v, centre, (reach, slim * reach), angle), out=shape)
    green = ((np.abs(u - 0.5 - 0.04 * np.sin(9 * v)) < 0.018) & (v > middle[1])).astype(np.float32)
    for k in range(leaves):
        side, height = (-1) ** k, 0.92 - 0.3 * (k // 2) - 0.1 * (k % 2)
        leaf = ellipse(u, v, (0.5 + 0.17 * side, height - 0.08), (0.16, 0.055), -0.6 * side)
        np.maximum(green, leaf, out=green)
    return green, shape, ellipse(u, v, middle, (0.55 * reach, 0.55 * reach)).astype(np.float32)
