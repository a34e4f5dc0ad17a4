"""Do two things touch: a test of hulls in the ground plane and along one free axis."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import ConvexHull, QhullError

_ANGLES = np.arange(16) * (np.pi / 8)
_AXES = np.stack([np.cos(_ANGLES), np.sin(_ANGLES)], axis=1)


@dataclass(frozen=True)
class Footprint:
    """A bound of a solid: its shadow on the ground, its heights, its depths along one axis.

    outline: (N, 2) convex hull in the ground plane. support: (16,) extents of the outline along sixteen
    directions. heights: lowest and highest z. depths: least and greatest coordinate along the axis.
    """

    outline: np.ndarray
    support: np.ndarray
    heights: tuple[float, float]
    depths: tuple[float, float]

    @staticmethod
    def of(vertices: np.ndarray, axis: np.ndarray) -> Footprint:
        """The footprint of world points (V, 3); `axis` (3,) a unit vector, such as the direction of view."""
        try:
            outline = vertices[ConvexHull(vertices[:, :2]).vertices, :2]
        except QhullError:  # everything on one line
            outline = vertices[:, :2]
        depth = vertices @ axis
        return Footprint(
            outline,
            (outline @ _AXES.T).max(0),
            (float(vertices[:, 2].min()), float(vertices[:, 2].max())),
            (float(depth.min()), float(depth.max())),
        )

    def clear_of(self, other: Footprint, margin: float) -> bool:
        """Whether `margin` metres along one of the axes lie between the two; may say no too often."""
        gap = -(self.support + np.roll(other.support, 8)).min()
        gap = max(gap, self.heights[0] - other.heights[1], other.heights[0] - self.heights[1])
        return max(gap, self.depths[0] - other.depths[1], other.depths[0] - self.depths[1]) >= margin

    def within(self, directions: np.ndarray, extents: tuple[float, ...], margin: float) -> bool:
        """Whether the outline stays `margin` inside the half-planes direction . x <= extent."""
        return bool((self.outline @ directions.T <= np.array(extents) - margin).all())
