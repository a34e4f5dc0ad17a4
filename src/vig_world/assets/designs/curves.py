"""Plane curves: cubic Bezier pieces joined into polylines and resampled by arc length."""

import numpy as np
from numpy.typing import ArrayLike
from scipy.ndimage import gaussian_filter1d

_DENSE = np.linspace(0.0, 1.0, 65)


def bezier(*controls: ArrayLike) -> np.ndarray:
    """Return a cubic Bezier piece through four control points, densely sampled: (65, 2)."""
    p0, p1, p2, p3 = (np.asarray(control, np.float64) for control in controls)
    t = _DENSE[:, None]
    s = 1.0 - t
    return s**3 * p0 + 3.0 * s**2 * t * p1 + 3.0 * s * t**2 * p2 + t**3 * p3


def join(*pieces: np.ndarray) -> np.ndarray:
    """Return pieces that meet end to start as one polyline, (N, 2), the shared points kept once."""
    return np.concatenate([pieces[0], *(piece[1:] for piece in pieces[1:])])


def arc_fraction(points: np.ndarray) -> np.ndarray:
    """Return arc length up to each point of a polyline (N, 2), as a fraction of the whole: (N,) in [0, 1]."""
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    return length / length[-1]


def resample(points: np.ndarray, fractions: np.ndarray) -> np.ndarray:
    """Return points of a polyline (N, 2) at given fractions (...) of its arc length: (..., 2)."""
    s = arc_fraction(points)
    return np.stack([np.interp(fractions, s, points[:, k]) for k in range(2)], axis=-1)


def tangents(points: np.ndarray, fractions: np.ndarray) -> np.ndarray:
    """Return unit tangents (M, 2) of a smooth polyline (N, 2) at fractions (M,) of its arc length."""
    even = np.linspace(0.0, 1.0, 400)
    direction = np.gradient(resample(points, even), axis=0, edge_order=2)
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    found = np.stack([np.interp(fractions, even, column) for column in direction.T], axis=1)
    return found / np.linalg.norm(found, axis=1, keepdims=True)


def smooth(points: np.ndarray, width: float) -> np.ndarray:
    """Return a polyline (N, 2) resampled evenly and blurred along itself, its ends kept: (400, 2).

    `width` is the standard deviation of the Gaussian, as a fraction of the arc length.
    """
    even = resample(points, np.linspace(0.0, 1.0, 400))
    before, after = 2.0 * even[0] - even[:0:-1], 2.0 * even[-1] - even[-2::-1]
    blurred = gaussian_filter1d(np.concatenate([before, even, after]), 400 * width, axis=0)
    return blurred[len(before) : len(before) + 400]


def squared_circle(angle: np.ndarray, squareness: float) -> np.ndarray:
    """Return radii by angle of a section between the unit circle (0) and a rounded square round it (1)."""
    square = (np.abs(np.cos(angle)) ** 6 + np.abs(np.sin(angle)) ** 6) ** (-1.0 / 6.0)
    return 1.0 + squareness * (square - 1.0)


def smoothstep(x: ArrayLike) -> np.ndarray:
    """Return 0 below 0, 1 above 1, and a smooth rise between."""
    x = np.clip(np.asarray(x, np.float64), 0.0, 1.0)
    return x * x * (3.0 - 2.0 * x)
