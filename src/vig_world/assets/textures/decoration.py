"""Painted decoration for ceramics, with its coverage."""

import numpy as np
from numpy.typing import NDArray

from vig_world.assets.textures.colours import BRIGHTEST, DARKEST, accent, near, partner
from vig_world.assets.textures.fields import Array, blossom, ellipse

_COBALT = np.array([0.02, 0.06, 0.30], np.float32)
_GOLD = np.array([0.62, 0.42, 0.12], np.float32)
_KEY = np.array(  # one period of a meander, row 0 on top
    [[1, 1, 1, 1, 1, 1, 1, 0], [1, 0, 0, 0, 0, 0, 1, 0], [1, 0, 1, 1, 1, 0, 1, 0], [1, 0, 1, 0, 1, 0, 1, 0],
     [1, 0, 1, 0, 0, 0, 1, 0], [1, 0, 1, 1, 1, 1, 1, 0], [1, 0, 0, 0, 0, 0, 0, 0], [1, 1, 1, 1, 1, 1, 1, 1]],
    np.float32,
)  # fmt: skip


def decoration(rng: np.random.Generator, size: int = 128) -> NDArray[np.float32]:
    """Draw one painted decoration: rings, dots, sprigs, blue-and-white or a Greek key.

    Args:
        rng: Source of all randomness.
        size: Height in pixels, at least 32.

    Returns:
        (size, 2 * size, 4) float32: linear RGB in [0.02, 0.95] and coverage in [0, 1], not multiplied with
        each other. u runs round the axis, where it is periodic; row 0 is the upper edge (v = 1).

    Raises:
        ValueError: For a size below 32.
    """
    if size < 32:
        raise ValueError(f"size must be at least 32 pixels; got {size}.")
    layer = np.zeros((size, 2 * size, 4), np.float32)
    style = (_rings, _dots, _sprigs, _blue_and_white, _greek_key)[rng.integers(5)]
    layer[..., :3] = style_colour = near(_COBALT if style is _blue_and_white else accent(rng), rng, 0.2)
    style(rng, layer, style_colour)
    layer[..., :3] = np.clip(layer[..., :3], DARKEST, BRIGHTEST)
    return layer


def _over(layer: Array, cover: Array, tint: Array, row: int = 0, column: int = 0) -> None:
    """Paint coverage (h, w) over the layer from a row and column on; columns go round."""
    rows = np.arange(max(row, 0), min(row + len(cover), len(layer)))
    columns = (column + np.arange(cover.shape[1])) % layer.shape[1]
    cover = cover[rows - row][..., None]
    window = layer[rows[:, None], columns]
    alpha = window[..., 3:]
    both = alpha + cover - alpha * cover
    window[..., :3] = (tint * cover + window[..., :3] * alpha * (1 - cover)) / np.maximum(both, 1e-6) + (
        tint * (both < 1e-6)
    )
    window[..., 3:] = both
    layer[rows[:, None], columns] = window


def _ring(rng: np.random.Generator, layer: Array, at: float, width: float, tint: Array) -> None:
    """Paint a line round the pot at height 1 - `at`, of a brush that trembles."""
    height, around = layer.shape[:2]
    turn = 2 * np.pi * np.arange(around) / around
    wobble = 0.06 * width * np.sin(int(rng.integers(2, 6)) * turn + rng.uniform(0, 6))
    v = (np.arange(height)[:, None] + 0.5) / height
    cover = np.clip((width / 2 - np.abs(v - at - wobble)) * height + 0.5, 0, 1)
    _over(layer, cover * rng.uniform(0.85, 1.0), tint)


def _rings(rng: np.random.Generator, layer: Array, tint: Array) -> None:
    second = _GOLD if rng.uniform() < 0.3 else partner(tint, rng)
    for _ in range(rng.integers(2, 6)):
        width = rng.uniform(0.008, 0.09)
        _ring(rng, layer, rng.uniform(0.05, 0.95), width, tint if rng.uniform() < 0.6 else second)


def _dots(rng: np.random.Generator, layer: Array, tint: Array) -> None:
    height, around = layer.shape[:2]
    rows = int(rng.integers(3, 9))
    v, u = (np.arange(height)[:, None] + 0.5) / height * rows, (np.arange(around) + 0.5) / around * 2 * rows
    x, y = (u + 0.5 * (np.floor(v) % 2)) % 1, v % 1
    radius = rng.uniform(0.12, 0.36)
    cover = ellipse(x, y, (0.5, 0.5), (radius, radius))
    _over(layer, cover * (v > rng.choice([0, rows // 2])), tint)
    if rng.uniform() < 0.4:
        _ring(rng, layer, rng.uniform(0.03, 0.1), 0.03, tint)


def _stamp_flowers(
    rng: np.random.Generator, layer: Array, tints: tuple[Array, Array, Array], count: int
) -> None:
    """Stamp flowers of one kind round the pot, evenly with some play."""
    height, around = layer.shape[:2]
    side = int(height * rng.uniform(0.3, 0.6))
    middle = rng.uniform(0.35, 0.65) * height
    motif = blossom(side, rng, int(rng.integers(4, 9)), int(rng.integers(2, 5)))
    for k in range(count):
        row = int(middle - side / 2 + rng.normal(0, 0.05) * height)
        column = int((k + rng.uniform(-0.15, 0.15)) * around / count)
        flip = slice(None, None, 1 if rng.uniform() < 0.5 else -1)
        for cover, tint in zip(motif, tints, strict=True):
            _over(layer, cover[:, flip], tint, row, column)


def _sprigs(rng: np.random.Generator, layer: Array, tint: Array) -> None:
    tints = (near([0.10, 0.20, 0.07], rng, 0.4), tint, near([0.6, 0.4, 0.08], rng, 0.3))
    _stamp_flowers(rng, layer, tints, int(rng.integers(3, 9)))
    if rng.uniform() < 0.6:
        _ring(rng, layer, 0.06, 0.03, _GOLD if rng.uniform() < 0.4 else tint)


def _blue_and_white(rng: np.random.Generator, layer: Array, tint: Array) -> None:
    _stamp_flowers(rng, layer, (tint, 2.2 * tint, tint), int(rng.integers(3, 6)))
    _stamp_flowers(rng, layer, (1.6 * tint, tint, tint), int(rng.integers(4, 9)))
    for at in (0.05, 0.1, 0.93):
        _ring(rng, layer, at, rng.uniform(0.01, 0.03), tint)
    height, around = layer.shape[:2]
    turn = np.arange(around) / around * int(rng.integers(8, 20))
    scallop = 0.13 + 0.05 * np.abs(np.sin(np.pi * turn))
    v = (np.arange(height)[:, None] + 0.5) / height
    _over(layer, np.clip(1 - np.abs(v - scallop) * height / 1.5, 0, 1), tint)


def _greek_key(rng: np.random.Generator, layer: Array, tint: Array) -> None:
    height, around = layer.shape[:2]
    pitch = 1 if height < 64 else int(rng.choice([height // 64, height // 32]))
    key = np.kron(_KEY, np.ones((pitch, pitch), np.float32))
    repeats = -(-around // key.shape[1])
    cover = np.tile(key, (1, repeats))[:, (np.arange(around) * repeats * key.shape[1]) // around]
    top = rng.uniform(0.05, 0.6)
    _over(layer, cover, tint, int(top * height))
    for at in (top - 0.02, top + (len(cover) + 1) / height + 0.02):
        _ring(rng, layer, at, 0.02, tint)
