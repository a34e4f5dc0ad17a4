"""Filters of pictures and masks in numpy; scipy's take a third of a second to load."""

import numpy as np


def gaussian_filter(image: np.ndarray, deviation: float, mode: str = "edge") -> np.ndarray:
    """Return a picture (H, W) or (H, W, C) smoothed by a Gaussian cut off at four deviations, in pixels; its
    dtype.

    mode: Continuation beyond the border, as `numpy.pad` names it.
    """
    radius = int(4 * deviation + 0.5)
    weights = np.exp(-0.5 * (np.arange(radius + 1) / deviation) ** 2)
    weights /= 2 * weights.sum() - weights[0]
    smooth = image.astype(np.float64)
    for axis in (0, 1):
        lines = np.moveaxis(smooth, axis, 0)
        size = len(lines)
        lines = np.pad(lines, [(radius, radius)] + [(0, 0)] * (lines.ndim - 1), mode=mode)  # type: ignore[call-overload]
        total = weights[0] * lines[radius : radius + size]
        for offset in range(1, radius + 1):
            below, above = radius - offset, radius + offset
            total += weights[offset] * (lines[below : below + size] + lines[above : above + size])
        smooth = np.moveaxis(total, 0, axis)
    return smooth.astype(image.dtype)


def dilation(mask: np.ndarray, steps: int) -> np.ndarray:
    """Return a mask (H, W) bool grown by so many pixels along rows and columns."""
    grown = mask.copy()
    for _ in range(steps):
        before = grown.copy()
        grown[1:] |= before[:-1]
        grown[:-1] |= before[1:]
        grown[:, 1:] |= before[:, :-1]
        grown[:, :-1] |= before[:, 1:]
    return grown


def erosion(mask: np.ndarray, steps: int) -> np.ndarray:
    """Return a mask (H, W) bool shrunk by so many pixels; beyond the border is none of it."""
    outside = dilation(np.pad(~mask, steps, constant_values=True), steps)
    return ~outside[steps : len(outside) - steps, steps : outside.shape[1] - steps]
