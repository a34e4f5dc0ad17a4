"""The revolved parts: body with foot, lid and knob, as profiles (radius, height) and rings of vertices."""

from dataclasses import dataclass

import numpy as np

from vig_world.assets.designs.curves import arc_fraction, bezier, join, resample, smoothstep, squared_circle
from vig_world.assets.designs.design import TeapotDesign
from vig_world.assets.designs.topology import Loft

_AROUND = 44
FOOT_RINGS = 7  # rings of BODY_LOFT that belong to the foot, its underside included
_WALL_RINGS = 18
BODY_LOFT = Loft((1, 11, 22, *[_AROUND] * (4 + _WALL_RINGS + 4), 22, 11, 1))
LID_LOFT = Loft((1, 11, 22, *[_AROUND] * 5, 22, 22, 11, 1))
KNOB_LOFT = Loft((1, 10, *[20] * 8, 10, 1))


@dataclass(frozen=True)
class BodyProfile:
    """The body's profile from foot to shoulder: dense points (N, 2) of (radius, height), metres."""

    points: np.ndarray

    def radius(self, height: float | np.ndarray) -> np.ndarray:
        """Return the radius of the body at given heights, metres."""
        order = np.argsort(self.points[:, 1], kind="stable")
        return np.interp(height, self.points[order, 1], self.points[order, 0])

    def shoulder(self, radius: float) -> float:
        """Return the height at which the body, above its belly, has narrowed to a radius, metres."""
        upper = self.points[np.argmax(self.points[:, 0]) :]
        return float(np.interp(-radius, -np.maximum.accumulate(upper[::-1, 0])[::-1], upper[:, 1]))


def wall(design: TeapotDesign) -> BodyProfile:
    """Return the body's dense profile; foot, neck and rim come before and after it."""
    d = design
    base = np.array([d.base_radius, d.foot_height])
    belly = np.array([d.belly_radius, d.belly_height])
    neck = np.array([d.neck_radius, d.shoulder_height])
    down, up = belly - base, neck - belly
    lower = bezier(
        base,
        base + [d.base_fullness * down[0], 0.04 * down[1]],
        belly - [0.0, d.base_fullness * down[1]],
        belly,
    )
    upper = bezier(
        belly,
        belly + [0.0, d.upper_fullness * up[1]],
        neck - [d.shoulder_reach * up[0], d.neck_sweep * up[1]],
        neck,
    )
    return BodyProfile(join(lower, upper))


def rim(design: TeapotDesign) -> tuple[float, float]:
    """Return outer radius and height of the body's rim, metres."""
    return design.neck_radius + design.rim_flare, design.shoulder_height + design.neck_height


def body_vertices(design: TeapotDesign) -> np.ndarray:
    """Return body and foot as one closed surface over BODY_LOFT, (V, 3)."""
    d = design
    foot = d.base_radius * d.foot_flare
    rim_radius, rim_height = rim(d)
    dense = wall(d).points
    side = resample(dense, np.linspace(0.0, 1.0, _WALL_RINGS))
    underside_recess = 0.002
    bottom = [
        (0.0, underside_recess),
        (0.35 * foot, underside_recess),
        (0.70 * foot, underside_recess),
        (0.90 * foot, 0.0),
        (foot - 0.001, 0.0),
        (foot, 0.3 * d.foot_height),
        (0.5 * (foot + d.base_radius) - 0.05 * (foot - d.base_radius), 0.7 * d.foot_height),
    ]
    rim_rounding = 0.0015
    top = [
        (d.neck_radius + 0.3 * d.rim_flare, d.shoulder_height + 0.5 * d.neck_height),
        (rim_radius, rim_height - 0.3 * rim_rounding),
        (rim_radius - rim_rounding, rim_height),
        (rim_radius - 0.007, rim_height - 0.0003),
        (0.6 * rim_radius, rim_height - 0.0005),
        (0.3 * rim_radius, rim_height - 0.0005),
        (0.0, rim_height - 0.0005),
    ]
    profile = np.concatenate([bottom, side, top])
    # The section is square at the belly, and turns into the foot's and the lid's below and above.
    along = arc_fraction(profile[FOOT_RINGS : FOOT_RINGS + _WALL_RINGS])
    square_side = d.squareness + (d.lid_squareness - d.squareness) * smoothstep((along - 0.6) / 0.4)
    square = np.concatenate(
        [np.full(len(bottom), d.squareness), square_side, np.full(len(top), d.lid_squareness)]
    )
    vertices = _revolve(BODY_LOFT, profile, square, d.belly_aspect)
    if d.lobes:
        # Ribs and flat sides are those of the wall; foot and rim are round.
        depth = np.concatenate(
            [
                np.zeros(len(bottom)),
                smoothstep(4.0 * along) * smoothstep(3.0 * (1.0 - along)),
                np.zeros(len(top)),
            ]
        )
        vertices[:, :2] *= _lobe_factor(d, vertices, np.repeat(depth, BODY_LOFT.counts))[:, None]
    return vertices


def _lobe_factor(design: TeapotDesign, vertices: np.ndarray, depth: np.ndarray) -> np.ndarray:
    """Return the factor of each vertex's radius (V,) by ribs and flat sides, where `depth` (V,) is 0 to 1."""
    d = design
    angle = np.arctan2(vertices[:, 1], vertices[:, 0])
    ribs = d.lobe_depth * np.cos(d.lobes * angle)
    # The middle of a side, not a corner, is in front: spout and handle meet a flat.
    side = 2.0 * np.pi / d.lobes
    polygon = np.cos(0.5 * side) / np.cos((angle + 0.5 * side) % side - 0.5 * side)
    return 1.0 + depth * (ribs + d.lobe_flatness * (polygon / np.sqrt(np.cos(0.5 * side)) - 1.0))


def lid_vertices(design: TeapotDesign) -> np.ndarray:
    """Return the lid as a closed surface over LID_LOFT, (V, 3)."""
    d = design
    rim_radius, rim_height = rim(d)
    radius = rim_radius + d.lid_overhang
    seat = rim_height - 0.003  # how deep the lid's edge reaches below the rim's top
    edge = rim_height + d.lid_thickness
    top = edge + d.lid_height
    dome_edge = np.array([radius - 0.25 * d.lid_thickness, edge])
    dome = bezier(
        dome_edge,
        [radius * (0.55 + 0.42 * d.lid_roundness), edge + d.lid_roundness * d.lid_height],
        [radius * (0.30 + 0.50 * d.lid_roundness), top],
        [0.0, top],
    )
    profile = np.concatenate(
        [
            [(0.0, seat), (0.35 * radius, seat), (0.7 * radius, seat), (radius - 0.001, seat)],
            [(radius, rim_height + 0.1 * d.lid_thickness), (radius, rim_height + 0.7 * d.lid_thickness)],
            resample(dome, np.array([0.0, 0.27, 0.52, 0.70, 0.86, 1.0])),
        ]
    )
    return _revolve(LID_LOFT, profile, np.full(len(profile), d.lid_squareness), d.belly_aspect)


def lid_top(design: TeapotDesign) -> float:
    """Return the height of the top of the lid's dome, metres."""
    return rim(design)[1] + design.lid_thickness + design.lid_height


def knob_vertices(design: TeapotDesign) -> np.ndarray:
    """Return the knob as a closed surface over KNOB_LOFT, its foot sunk into the lid, (V, 3)."""
    d = design
    foot = lid_top(d)
    waist = np.array([d.knob_radius * d.knob_waist, foot + 0.35 * d.knob_bulge * d.knob_height])
    widest = np.array([d.knob_radius, foot + d.knob_bulge * d.knob_height])
    top = np.array([0.0, foot + d.knob_height])
    base = np.array([d.knob_radius * d.knob_base, foot - 0.004])
    rise, crown = widest[1] - waist[1], top[1] - widest[1]
    dense = join(
        bezier(base, base + [0.0, 0.6 * (foot - base[1])], waist - [0.0, 0.45 * (waist[1] - base[1])], waist),
        bezier(waist, waist + [0.0, 0.4 * rise], widest - [0.0, 0.55 * rise], widest),
        bezier(
            widest, widest + [0.0, d.knob_flatness * crown], top + [d.knob_flatness * d.knob_radius, 0.0], top
        ),
    )
    side = resample(dense, np.linspace(0.0, 1.0, 10))
    profile = np.concatenate([[(0.0, base[1]), (0.5 * base[0], base[1])], side])
    return _revolve(KNOB_LOFT, profile, np.zeros(len(profile)), 1.0)


def _revolve(loft: Loft, profile: np.ndarray, square: np.ndarray, aspect: float) -> np.ndarray:
    """Return vertices (V, 3) of a profile (rings, 2) of (radius, height) with squareness (rings,)."""
    rings = []
    for count, (radius, height), squareness in zip(loft.counts, profile, square, strict=True):
        angle = 2.0 * np.pi * np.arange(count) / count
        reach = radius * squared_circle(angle, squareness)
        x, y = reach * np.cos(angle), aspect * reach * np.sin(angle)
        rings.append(np.stack([x, y, np.full(count, height)], axis=1))
    return np.concatenate(rings)
