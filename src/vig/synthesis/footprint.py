"""Do two things touch: a test of extents along sixteen level axes, upwards, and along one free axis."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

_ANGLES = np.arange(16) * (np.pi / 8)
_OPPOSITE = (np.arange(16) + 8) % 16
_AXES = np.stack([np.cos(_ANGLES), np.sin(_ANGLES)], axis=1)


@lru_cache(maxsize=1)
def _hull_directions() -> np.ndarray:
    """Unit vectors (130, 3) float32 spread over the sphere, level ones among them."""
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
    """The points of (V, 3) farthest in each of 130 directions, (130, 3) float64: a lean convex hull."""
    farthest = (_hull_directions() @ vertices.astype(np.float32).T).argmax(axis=1)
    return vertices[farthest].astype(np.float64)


@dataclass(frozen=True)
class Footprint:
    """A bound of a solid: its shadow on the ground, its heights, its depths along one axis.

    outline: (N, 2) points whose convex hull is its shadow. support: (16,) extents of the outline along
    sixteen directions. heights: lowest and highest z. depths: least and greatest coordinate along the axis.
    """

    outline: np.ndarray
    support: np.ndarray
    heights: tuple[float, float]
    depths: tuple[float, float]

    @staticmethod
    def of(points: np.ndarray, axis: np.ndarray) -> Footprint:
        """The footprint of world points (N, 3); `axis` (3,) a unit vector, such as the direction of view."""
        depth, height = points @ axis, points[:, 2]
        return Footprint(
            points[:, :2],
            (points[:, :2] @ _AXES.T).max(0),
            (float(height.min()), float(height.max())),
            (float(depth.min()), float(depth.max())),
        )

    def gap(self, other: Footprint) -> float:
        """At least this many metres lie between the two along one of the axes; may be too small."""
        gap = -float((self.support + other.support[_OPPOSITE]).min())
        gap = max(gap, self.heights[0] - other.heights[1], other.heights[0] - self.heights[1])
        return max(gap, self.depths[0] - other.depths[1], other.depths[0] - self.depths[1])

    def clear_of(self, other: Footprint, margin: float) -> bool:
        """Whether `margin` metres lie between the two; may say no too often."""
        return self.gap(other) >= margin


@dataclass(frozen=True)
class Footprints:
    """Those of N solids: outlines (N, P, 2), support (N, 16), heights (N, 2), depths (N, 2)."""

    outlines: np.ndarray
    support: np.ndarray
    heights: np.ndarray
    depths: np.ndarray

    @staticmethod
    def of(clouds: np.ndarray, axis: np.ndarray) -> Footprints:
        """The footprints of clouds of world points (N, P, 3); see `Footprint.of`."""
        depth, height = clouds @ axis, clouds[..., 2]
        return Footprints(
            clouds[..., :2],
            (clouds[..., :2] @ _AXES.T).max(1),
            np.stack([height.min(1), height.max(1)], axis=1),
            np.stack([depth.min(1), depth.max(1)], axis=1),
        )

    def __getitem__(self, number: int) -> Footprint:
        low, high = self.heights[number].tolist()
        near, far = self.depths[number].tolist()
        return Footprint(self.outlines[number], self.support[number], (low, high), (near, far))

    def gaps(self, others: list[Footprint]) -> np.ndarray:
        """`Footprint.gap` between each of these and each of M others: (N, M)."""
        support = np.array([other.support[_OPPOSITE] for other in others])
        gaps = -(self.support[:, None] + support).min(2)
        for own, theirs in (
            (self.heights, np.array([other.heights for other in others])),
            (self.depths, np.array([other.depths for other in others])),
        ):
            gaps = np.maximum(gaps, own[:, None, 0] - theirs[:, 1])
            gaps = np.maximum(gaps, theirs[:, 0] - own[:, None, 1])
        return gaps
