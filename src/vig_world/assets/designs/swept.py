"""The swept parts: spout and handle, as sections moved along a centre line in the plane y = 0."""

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
from vig_world.assets.designs.design import TeapotDesign
from vig_world.assets.designs.revolved import BodyProfile, lid_top
from vig_world.assets.designs.topology import Loft

_SPOUT_AROUND = 20
_SPOUT_RINGS = 21
_HANDLE_AROUND = 12
_HANDLE_RINGS = 38
SPOUT_LOFT = Loft((1, 10, *[_SPOUT_AROUND] * _SPOUT_RINGS, 20, 10, 1))
HANDLE_LOFT = Loft((1, 6, *[_HANDLE_AROUND] * _HANDLE_RINGS, 6, 1))

_HANDLE_FLARE = 1.55  # scale of the handle's section at its ends


def spout_vertices(design: TeapotDesign, wall: BodyProfile) -> np.ndarray:
    """Return the spout, a closed surface over SPOUT_LOFT, from in the body to the mouth's dimple, (V, 3)."""
    d = design
    base_slope, tip_slope = np.radians(d.spout_base_angle), np.radians(d.spout_tip_angle)
    spout_flare = 0.18  # extra radius at the spout's base
    base_radius = (1.0 + spout_flare) * d.spout_base_radius
    half_height = base_radius * d.spout_ellipticity / np.cos(base_slope)
    start = np.array([_inside(d, wall, d.spout_base_height, half_height, base_radius), d.spout_base_height])
    tip = np.array([d.belly_radius + d.spout_reach, d.spout_tip_height])
    pull = (0.15 + d.spout_bend) * np.linalg.norm(tip - start)
    dense = bezier(
        start,
        start + pull * np.array([np.cos(base_slope), np.sin(base_slope)]),
        tip - pull * np.array([np.cos(tip_slope), np.sin(tip_slope)]),
        tip,
    )
    u = np.linspace(0.0, 1.0, _SPOUT_RINGS)
    centre, tangent = resample(dense, u), tangents(dense, u)
    radius = d.spout_tip_radius + (d.spout_base_radius - d.spout_tip_radius) * (1.0 - u) ** d.spout_taper
    radius = radius + spout_flare * d.spout_base_radius * (1.0 - smoothstep(u / 0.4))
    height = radius * (1.0 + (d.spout_ellipticity - 1.0) * (1.0 - u))
    # Sections lean from upright at the body (the base hides well) over square to the mouth's cut.
    cut = np.tan(np.radians(d.mouth_tilt))
    lean = cut * smoothstep((u - 0.65) / 0.35) - np.tan(base_slope) * (1.0 - smoothstep(u / 0.8))
    rings = [
        _section(_SPOUT_AROUND, *ring) for ring in zip(centre, tangent, height, radius, lean, strict=True)
    ]
    mouth, out = centre[-1], tangent[-1]
    dimple = [
        _section(n, mouth - depth * out, out, scale * height[-1], scale * radius[-1], lean[-1])
        for n, scale, depth in ((20, 0.74, 0.001), (10, 0.55, 0.007), (1, 0.0, 0.009))
    ]
    return np.concatenate([*_cap(rings[0], 10), *rings, *dimple])


def handle_vertices(design: TeapotDesign, wall: BodyProfile) -> np.ndarray:
    """Return the handle as a closed surface over HANDLE_LOFT, both ends inside the body, (V, 3).

    Its rings run from the lower end to the upper one; above the lid, from the back to the front, which is the
    ear turned about the pot: the two blend into each other.
    """
    d = design
    half, side = 0.5 * d.handle_thickness, 0.5 * d.handle_width
    line = {"behind": _ear, "above": _bail, "straight": _grip}[d.handle]
    u = np.linspace(0.0, 1.0, _HANDLE_RINGS)
    dense = line(d, wall)
    centre, tangent = resample(dense, u), tangents(dense, u)
    swell = 1.0 + (_HANDLE_FLARE - 1.0) * (2.0 * np.abs(u - 0.5)) ** 5
    lean = np.zeros(_HANDLE_RINGS)
    if d.handle != "above":
        # The end sections lean upright, parallel to the body's wall.
        upright = -tangent[[0, -1], 1] / tangent[[0, -1], 0]
        lean = upright[0] * (1.0 - smoothstep(u / 0.2)) + upright[-1] * smoothstep((u - 0.8) / 0.2)
    rings = [
        _section(_HANDLE_AROUND, c, t, half * s, side * s, a, d.handle_squareness)
        for c, t, s, a in zip(centre, tangent, swell, lean, strict=True)
    ]
    return np.concatenate([*_cap(rings[0], 6), *rings, *_cap(rings[-1], 6)[::-1]])


def _ear(d: TeapotDesign, wall: BodyProfile) -> np.ndarray:
    """Return the centre line (N, 2) of (x, z) of a handle behind the body, from the lower end."""
    end_half, end_side = 0.5 * _HANDLE_FLARE * d.handle_thickness, 0.5 * _HANDLE_FLARE * d.handle_width
    rise, drop = np.radians(d.handle_rise), np.radians(d.handle_drop)
    top_x = -_inside(d, wall, d.handle_top, end_half / np.cos(rise), end_side)
    bottom_x = -_inside(d, wall, d.handle_bottom, end_half / np.cos(drop), end_side)
    peak_height = d.handle_bottom + d.handle_peak * (d.handle_top - d.handle_bottom)
    top, bottom = np.array([top_x, d.handle_top]), np.array([bottom_x, d.handle_bottom])
    peak = np.array([-(d.belly_radius + d.handle_reach), peak_height])
    upper, lower = d.handle_upper_roundness, d.handle_lower_roundness
    dense = join(
        bezier(
            bottom,
            bottom + lower * (bottom[0] - peak[0]) * np.array([-np.cos(drop), np.sin(drop)]),
            peak - [0.0, lower * (peak[1] - bottom[1])],
            peak,
        ),
        bezier(
            peak,
            peak + [0.0, upper * (top[1] - peak[1])],
            top + upper * (top[0] - peak[0]) * np.array([-np.cos(rise), np.sin(rise)]),
            top,
        ),
    )
    return smooth(dense, 0.035)


def _bail(d: TeapotDesign, wall: BodyProfile) -> np.ndarray:
    """Return the centre line (N, 2) of (x, z) of a handle above the lid, from the back shoulder."""
    span, widest = d.bail_span * d.belly_radius, (d.bail_span + d.bail_swell) * d.belly_radius
    end = wall.shoulder(span)
    top = np.array([d.bail_shift * d.belly_radius, lid_top(d) + d.bail_height])
    middle = end + 0.45 * (top[1] - end)
    pieces = []
    for sign in (-1.0, 1.0):
        # the ends reach below the shoulder
        foot, out = np.array([sign * span, end - 0.014]), np.array([sign * widest, middle])
        rise, reach = middle - foot[1], abs(out[0] - top[0])
        leg = bezier(foot, foot + [0.0, 0.4 * rise], out - [0.0, 0.5 * rise], out)
        arc = bezier(
            out,
            out + [0.0, d.handle_upper_roundness * (top[1] - middle)],
            top + [sign * d.handle_upper_roundness * reach, 0.0],
            top,
        )
        pieces += [leg, arc] if sign < 0.0 else [arc[::-1], leg[::-1]]
    return smooth(join(*pieces), 0.02)


def _grip(d: TeapotDesign, wall: BodyProfile) -> np.ndarray:
    """Return the centre line (N, 2) of (x, z) of a straight handle: out below, round its tip and back above.

    The halves of the loop touch, so that a grip is an ear without an opening, and the two blend.
    """
    slope = np.radians(d.handle_rise)
    way, up = np.array([-np.cos(slope), np.sin(slope)]), np.array([np.sin(slope), np.cos(slope)])
    # distance of the two halves of a straight handle / their thickness
    bend = 0.5 * 1.08 * d.handle_thickness
    half = (bend + 0.5 * _HANDLE_FLARE * d.handle_thickness) / np.cos(slope)
    base_x = -_inside(d, wall, d.handle_top, half, 0.5 * _HANDLE_FLARE * d.handle_width)
    base = np.array([base_x, d.handle_top])
    length = (d.belly_radius + d.handle_reach + base_x) / np.cos(slope)
    turn = np.linspace(-0.5 * np.pi, 0.5 * np.pi, 65)[:, None]
    tip = base + length * way + bend * (np.cos(turn) * way + np.sin(turn) * up)
    return np.concatenate([[base - bend * up], tip, [base + bend * up]])


def _inside(
    d: TeapotDesign, wall: BodyProfile, height: float, half_height: float, half_width: float
) -> float:
    """Return the largest x at which an upright elliptic section round `height` lies wholly in the body."""
    angle = np.linspace(0.0, np.pi, 33)
    radius = wall.radius(height + half_height * np.cos(angle))
    across = np.minimum(half_width * np.sin(angle) / d.belly_aspect, 0.95 * radius)
    # the ends of spout and handle stay below the body's surface
    return float(np.min(np.sqrt(radius**2 - across**2))) - 0.022


def _section(
    count: int,
    centre: np.ndarray,
    tangent: np.ndarray,
    half_height: float,
    half_width: float,
    lean: float,
    squareness: float = 0.0,
) -> np.ndarray:
    """Return a ring (count, 3) across a tangent (x, z): angle 0 lies to its right (below a rising spout).

    `lean` shears the section along the tangent: by that much per length on the right.
    """
    angle = 2.0 * np.pi * np.arange(count) / count
    reach = squared_circle(angle, squareness)
    across = half_height * reach * np.cos(angle)
    right = np.array([tangent[1], -tangent[0]])
    plane = centre + across[:, None] * (right + lean * tangent)
    return np.stack([plane[:, 0], half_width * reach * np.sin(angle), plane[:, 1]], axis=1)


def _cap(ring: np.ndarray, count: int) -> list[np.ndarray]:
    """Return a pole and a ring of `count`, half the vertices, that close a ring with a flat cap."""
    centre = ring.mean(axis=0, keepdims=True)
    return [centre, centre + 0.5 * (ring[:: len(ring) // count] - centre)]
