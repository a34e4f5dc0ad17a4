"""Textures as pyramids of 8-bit texels, each level half as wide and high as the one before."""

from dataclasses import dataclass

import numpy as np

MAX_TEXELS = 512  # most texels along a side; larger textures are reduced


@dataclass(frozen=True, eq=False)
class TextureLevels:
    """A texture for the rasteriser.

    Attributes:
        texels: (N,) uint32, all levels one after the other, the finest first, row 0 on top; red, green and
            blue are the three lowest bytes, each 255 times the square root of the linear value.
        log_size: log2 of the finest level's width and height.
    """

    texels: np.ndarray
    log_size: tuple[int, int]

    @staticmethod
    def of(texture: np.ndarray) -> "TextureLevels":
        """Return the pyramid of (h, w, 3) linear values in [0, 1].

        Sides become powers of two, at most 512, by averaging and linear interpolation across the edges: the
        texture repeats. Levels are box averages; the last is one texel wide or high.
        """
        level = np.asarray(texture, np.float32)
        for axis in (0, 1):
            level = _resample(level, axis)
        height, width = level.shape[:2]
        levels = [_encode(level)]
        while min(level.shape[:2]) > 1:
            level = 0.25 * (level[::2, ::2] + level[1::2, ::2] + level[::2, 1::2] + level[1::2, 1::2])
            levels.append(_encode(level))
        return TextureLevels(np.concatenate(levels), (width.bit_length() - 1, height.bit_length() - 1))


def _encode(level: np.ndarray) -> np.ndarray:
    root = np.sqrt(np.clip(level.reshape(-1, 3), 0, 1)) * 255 + 0.5
    return root.astype(np.uint32) @ np.array([1, 1 << 8, 1 << 16], np.uint32)


def _resample(level: np.ndarray, axis: int) -> np.ndarray:
    size = level.shape[axis]
    wanted = min(MAX_TEXELS, 1 << max(0, round(np.log2(size))))
    if size == wanted:
        return level
    level = np.moveaxis(level, axis, 0)
    while len(level) > 2 * wanted:
        even = len(level) // 2 * 2
        level = 0.5 * (level[:even:2] + level[1:even:2])
    place = (np.arange(wanted) + 0.5) * len(level) / wanted - 0.5
    low = np.floor(place).astype(int)
    share = (place - low).astype(np.float32).reshape(-1, 1, 1)
    mixed = level[low % len(level)] * (1 - share) + level[(low + 1) % len(level)] * share
    return np.moveaxis(mixed, 0, axis)
