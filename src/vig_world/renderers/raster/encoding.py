"""Linear light to 8-bit sRGB by tables, exactly rounded. In C++ for the sake of its speed."""

from __future__ import annotations

import functools

import numpy as np
import warp as wp

from vig.scene.colour import linear_from_srgb
from vig_world.renderers.raster.records import SAMPLES, native

_ENCODE = """
const int values = 3 * (task->width / SAMPLES) * (task->height / SAMPLES);
const float* const linear = (const float*)task->linear;
const unsigned char* const encode = (const unsigned char*)task->encode;
const float* const thresholds = (const float*)task->thresholds;
unsigned char* const image = (unsigned char*)task->image;
for (int n = 0; n < values; ++n) {
    const float value = linear[n] < 1 ? linear[n] : 1;
    const int level = encode[(int)(value * BINS)];
    image[n] = level + (value >= thresholds[level + 1]);
}
"""

BINS = 4096
"""Bins of linear light, each narrower than a level of 8-bit sRGB."""


@functools.cache
def srgb_tables() -> tuple[np.ndarray, np.ndarray]:
    """The 8-bit sRGB level of each bin's lower edge (BINS + 1,), and where each level begins (257,)."""
    thresholds = np.full(257, np.inf, np.float32)
    thresholds[:256] = linear_from_srgb((np.arange(256) - 0.5) / 255)
    thresholds[0] = 0
    edges = np.arange(BINS + 1, dtype=np.float32) / BINS
    return (np.searchsorted(thresholds, edges, side="right") - 1).astype(np.uint8), thresholds


@wp.func_native(snippet=native("Task", _ENCODE, SAMPLES=SAMPLES, BINS=BINS))
def encode_image(address: wp.uint64): ...
