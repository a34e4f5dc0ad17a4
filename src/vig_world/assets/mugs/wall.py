"""The wall of a mug, outside and inside, as profiles of (radius, height)."""

from dataclasses import dataclass

import numpy as np

from vig_world.assets.designs.curves import arc_fraction, resample, smoothstep
from vig_world.assets.mugs.design import MugDesign

_CORNER = np.sin(np.linspace(0.0, 0.5 * np.pi, 65))


@dataclass(frozen=True)
class Profile:
    """A dense curve (N, 2) of (radius, height), metres, whose height grows."""

    points: np.ndarray

    @property
    def length(self) -> float:
        """Return the arc length, metres."""
        return float(np.linalg.norm(np.diff(self.points, axis=0), axis=1).sum())

    def at(self, fraction: np.ndarray) -> np.ndarray:
        """Return points (..., 2) at fractions (...) of the arc length."""
        return resample(self.points, fraction)

    def fraction(self, height: float) -> float:
        """Return the fraction of the arc length at a height, metres."""
        return float(np.interp(height, self.points[:, 1], arc_fraction(self.points)))

    def radius(self, height: float | np.ndarray) -> np.ndarray:
        """Return the radius at heights, metres."""
        return np.interp(height, self.points[:, 1], self.points[:, 0])

    def tangent(self, fraction: float) -> np.ndarray:
        """Return the unit tangent (2,), upwards."""
        way: np.ndarray = np.diff(
            self.at(np.array([max(0.0, fraction - 0.01), min(1.0, fraction + 0.01)])), axis=0
        )[0]
        return way / np.linalg.norm(way)


def rim_rounding(design: MugDesign) -> tuple[float, float]:
    """Return half the rim's thickness, and the height over which it is rounded, metres."""
    half = 0.5 * (design.lip * design.wall + design.rim_bead)
    return half, design.rim_roundness * half


def outside(design: MugDesign) -> Profile:
    """Return the outer wall from the foot's top to where the rim begins."""
    top = design.height - 2.2 * rim_rounding(design)[1]
    heights = _heights(design.foot_height, design.corner_height, top)
    corner = _corner(heights - design.foot_height, design.corner_height, design.corner_inset)
    return Profile(np.stack([_radius(design, heights) - corner, heights], axis=1))


def inside(design: MugDesign) -> Profile:
    """Return the inner wall from the floor's edge to where the rim begins."""
    floor = design.foot_height + design.floor
    top = design.height - rim_rounding(design)[1]
    least_corner = 0.003  # metres, of the corner between wall and floor inside
    height = max(design.corner_height, least_corner)
    heights = _heights(floor, height, top)
    thinning = smoothstep((design.height - heights) / (0.25 * design.height))
    thickness = design.wall * (design.lip + (1.0 - design.lip) * thinning)
    corner = _corner(heights - floor, height, max(design.corner_inset, least_corner))
    return Profile(np.stack([_radius(design, heights) - thickness - corner, heights], axis=1))


def underside(design: MugDesign) -> np.ndarray:
    """Return points (7, 2) from the middle of the underside round the foot's ring to the wall."""
    start = outside(design).points[0, 0]
    foot = start - design.foot_inset
    underside_recess = 0.0012
    return np.array(
        [
            (0.0, underside_recess),
            (0.4 * foot, underside_recess),
            (0.7 * foot, underside_recess),
            (0.86 * foot, underside_recess),
            (0.9 * foot, 0.0),
            (foot - 0.0008, 0.0),
            (0.7 * foot + 0.3 * start, 0.5 * design.foot_height),
        ]
    )


def rim(design: MugDesign) -> np.ndarray:
    """Return points (4, 2) over the rim, from outside to inside."""
    half, rounding = rim_rounding(design)
    height = design.height - rounding
    middle = float(_radius(design, np.array([height]))[0]) + design.rim_bead - half
    angle = np.linspace(0.0, np.pi, 5)[:-1]
    return np.stack([middle + half * np.cos(angle), height + rounding * np.sin(angle)], axis=1)


def _radius(design: MugDesign, heights: np.ndarray) -> np.ndarray:
    """Return outer radius (N,) at heights (N,), without the corner at the bottom."""
    t, peak = heights / design.height, design.bulge_height
    bump = 1.0 - ((t - peak) / np.where(t < peak, peak, 1.0 - peak)) ** 2
    flare = np.clip((t - design.flare_start) / (1.0 - design.flare_start), 0.0, None) ** 2
    taper = design.base_ratio + (1.0 - design.base_ratio) * t
    return design.radius * (taper + design.bulge * bump + design.flare * flare)


def _corner(above: np.ndarray, height: float, inset: float) -> np.ndarray:
    """Return how far a quarter ellipse takes the wall back at heights (N,) above its lower end."""
    left = np.clip(1.0 - above / height, 0.0, 1.0)
    return inset * (1.0 - np.sqrt(1.0 - left**2))


def _heights(low: float, corner: float, top: float) -> np.ndarray:
    """Return heights from `low` to `top`, dense where a corner of a height is level."""
    end = min(low + corner, top)
    return np.concatenate([low + (end - low) * (1.0 - _CORNER[::-1]), np.linspace(end, top, 129)[1:]])
