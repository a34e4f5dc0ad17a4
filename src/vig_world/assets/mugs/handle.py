"""The handle: sections moved along a centre line in the plane y = 0, from the wall to the wall."""

import numpy as np

from vig_world.assets.designs.curves import (
    bezier,
    join,
    resample,
    smooth,
    smoothstep,
    squared_circle,
    tangents,
)
from vig_world.assets.mugs.design import MugDesign
from vig_world.assets.mugs.wall import Profile

AROUND = 16
RINGS = 26  # the handle's own rings, between the two loops of the wall
_ANGLE = 2.0 * np.pi * np.arange(AROUND) / AROUND
_FINE = np.linspace(0.0, 1.0, 400)
_ENDS, _BENDS = 0.3, 0.45  # degrees to which rings gather at the ends and where the line bends; 0: evenly


def section(squareness: float) -> np.ndarray:
    """Return a unit section (AROUND, 2) across (y) and in the plane, the latter upwards at the lower end."""
    reach = squared_circle(_ANGLE, squareness)
    return np.stack([reach * np.cos(_ANGLE), reach * np.sin(_ANGLE)], axis=1)


def half_sizes(design: MugDesign, upper: bool) -> tuple[float, float]:
    """Return half the width (across) and height (along the wall) of the handle at the wall, metres."""
    scale = design.handle_flare * (1.0 if upper else design.handle_taper)
    slope = np.radians(design.handle_rise if upper else design.handle_drop)
    height = 0.5 * scale * design.handle_thickness / max(float(np.cos(slope)), 0.6)
    return 0.5 * scale * design.handle_width, height


def centre_line(design: MugDesign, wall: Profile) -> np.ndarray:
    """Return a dense centre line (N, 2) of (x, z), from its lower end to its upper one, both on the wall."""
    d = design
    bottom, top = (np.array([float(wall.radius(z)), z]) for z in (d.handle_bottom, d.handle_top))
    span, out = d.handle_top - d.handle_bottom, max(bottom[0], top[0]) + d.handle_reach
    middle = d.handle_bottom + d.handle_peak * span
    half = 0.5 * d.handle_flat * span
    low = np.array([out - 0.5 * d.handle_lean, middle - half])
    high = np.array([out + 0.5 * d.handle_lean, middle + half])
    grip = np.array([d.handle_lean, max(span * max(d.handle_flat, 0.5), 1e-6)])
    grip = grip / np.linalg.norm(grip)
    rise, drop = np.radians(d.handle_rise), np.radians(d.handle_drop)
    upper, lower = d.handle_upper_roundness, d.handle_lower_roundness
    dense = join(
        bezier(
            bottom,
            bottom + lower * (low[0] - bottom[0]) * np.array([np.cos(drop), np.sin(drop)]),
            low - lower * (low[1] - bottom[1]) * grip,
            low,
        ),
        bezier(low, low + (high - low) / 3.0, high - (high - low) / 3.0, high),
        bezier(
            high,
            high + upper * (top[1] - high[1]) * grip,
            top + upper * (high[0] - top[0]) * np.array([np.cos(rise), np.sin(rise)]),
            top,
        ),
    )
    return smooth(dense, d.handle_softness)


def handle_rings(design: MugDesign, wall: Profile, loops: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
    """Return the handle's own rings (RINGS, AROUND, 3) between two loops (AROUND, 3) on the wall, metres."""
    d = design
    dense = centre_line(d, wall)
    even = resample(dense, _FINE)
    length = float(np.linalg.norm(np.diff(even, axis=0), axis=1).sum())
    u = _fractions(even, length, d.handle_thickness)
    direction, centre = tangents(dense, u), resample(dense, u)
    near = length * np.minimum(u, 1.0 - u) / (0.8 * d.handle_thickness)
    size = (d.handle_taper + (1.0 - d.handle_taper) * u) * (
        1.0 + (d.handle_flare - 1.0) * np.exp(-(near**1.5))
    )
    # Sections at the ends lie in the wall's slope.
    slopes = [wall.tangent(wall.fraction(z)) for z in (d.handle_bottom, d.handle_top)]
    leans = [
        np.clip((slope @ t) / (slope @ np.array([-t[1], t[0]])), -1.0, 1.0)
        for slope, t in zip(slopes, direction[[0, -1]], strict=True)
    ]
    # Share of the line over which sections turn from the wall's slope, and follow its roundness.
    blend = 0.2
    lower, upper = 1.0 - smoothstep(u / blend), smoothstep((u - 1.0 + blend) / blend)
    lean = leans[0] * lower + leans[1] * upper
    unit = section(d.handle_squareness) * [0.5 * d.handle_width, 0.5 * d.handle_thickness]
    up = np.stack([-direction[:, 1], direction[:, 0]], axis=1) + lean[:, None] * direction
    plane = centre[:, None] + (size[:, None] * unit[:, 1])[..., None] * up[:, None]
    rings = np.stack([plane[..., 0], size[:, None] * unit[:, 0], plane[..., 1]], axis=-1)
    rings += lower[:, None, None] ** 2 * (loops[0] - rings[0])
    rings += upper[:, None, None] ** 2 * (loops[1] - rings[-1])
    return rings[1:-1]


def _fractions(even: np.ndarray, length: float, thickness: float) -> np.ndarray:
    """Return fractions (RINGS + 2,) of the arc length, closer at the ends and where the line bends."""
    way = np.diff(even, axis=0)
    turn = np.abs(np.diff(np.unwrap(np.arctan2(way[:, 1], way[:, 0]))))
    bends = np.convolve(np.pad(turn, 11, mode="edge"), np.hanning(23), mode="valid")
    bends = np.interp(_FINE, np.linspace(0.0, 1.0, len(bends)), bends)
    ends = np.exp(-length * np.minimum(_FINE, 1.0 - _FINE) / thickness)
    density = (1.0 - _ENDS - _BENDS) + _ENDS * ends / ends.mean() + _BENDS * bends / max(bends.mean(), 1e-9)
    grown = np.concatenate([[0.0], np.cumsum(0.5 * (density[1:] + density[:-1]))])
    return np.interp(np.linspace(0.0, 1.0, RINGS + 2), grown / grown[-1], _FINE)
