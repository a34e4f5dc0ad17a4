"""Collision test of solids by their extents along sixteen level axes, upwards, and along one free axis."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import lru_cache
from typing import Any

import numpy as np

_ANGLES = np.arange(16) * (np.pi / 8)
_OPPOSITE = (np.arange(16) + 8) % 16
_AXES = np.stack([np.cos(_ANGLES), np.sin(_ANGLES)], axis=1)


@lru_cache(maxsize=1)
def _hull_directions() -> np.ndarray:
    """Return unit vectors (130, 3) float32 spread over the sphere, level ones among them."""
    rings: list[np.ndarray] = []
    for elevation, count in zip(
        np.arange(-4, 5) * (np.pi / 8), (1, 8, 16, 24, 32, 24, 16, 8, 1), strict=True
    ):
        angle = 2 * np.pi * np.arange(count) / count
        level = np.cos(elevation)
        rings.append(
            np.stack([level * np.cos(angle), level * np.sin(angle), 0 * angle + np.sin(elevation)], 1)
        )
    return np.concatenate(rings).astype(np.float32)


def extreme_points(vertices: np.ndarray) -> np.ndarray:
    """Return points of (V, 3) farthest in each of 130 directions, (130, 3) float64: a lean convex hull."""
    farthest = (_hull_directions() @ vertices.astype(np.float32).T).argmax(axis=1)
    return vertices[farthest].astype(np.float64)


@dataclass(frozen=True)
class Footprint:
    """A bound of a solid: its shadow on the ground, its heights, its depths along one axis.

    Attributes:
        outline: (..., P, 2) points whose convex hull is its shadow.
        support: (..., 16) extents of the outline along sixteen directions.
        heights: (..., 2) lowest and highest z.
        depths: (..., 2) least and greatest coordinate along the axis. Leading axes hold many solids at once.
    """

    outline: np.ndarray
    support: np.ndarray
    heights: np.ndarray
    depths: np.ndarray

    @staticmethod
    def of(points: np.ndarray, axis: np.ndarray) -> Footprint:
        """Return the footprint of world points (..., P, 3); `axis` (3,) a unit vector, such as the view's."""
        level = points[..., :2]
        return Footprint(level, (level @ _AXES.T).max(-2), _extent(points[..., 2]), _extent(points @ axis))

    @staticmethod
    def stack(footprints: Sequence[Footprint]) -> Footprint:
        """Return the footprints of N solids, with as many points each, as one of shape (N, ...)."""
        return Footprint(*(np.stack([getattr(each, name) for each in footprints]) for name in _FIELDS))

    def __getitem__(self, index: Any) -> Footprint:
        return Footprint(*(getattr(self, name)[index] for name in _FIELDS))

    def gap(self, other: Footprint) -> np.ndarray:
        """Return a lower bound, metres, of the distance between the two along one of the axes.

        Leading axes broadcast: `many[:, None].gap(others)` is (N, M).
        """
        gap = -(self.support + other.support[..., _OPPOSITE]).min(-1)
        for own, theirs in ((self.heights, other.heights), (self.depths, other.depths)):
            gap = np.maximum(gap, own[..., 0] - theirs[..., 1])
            gap = np.maximum(gap, theirs[..., 0] - own[..., 1])
        return gap


_FIELDS = tuple(field.name for field in fields(Footprint))


def _extent(values: np.ndarray) -> np.ndarray:
    """Return the least and greatest of values (..., P): (..., 2)."""
    extent = np.empty((*values.shape[:-1], 2))
    values.min(-1, out=extent[..., 0])
    values.max(-1, out=extent[..., 1])
    return extent
