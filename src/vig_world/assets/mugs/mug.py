"""Mug meshes in dense correspondence: vertex i means the same place on every design.

One closed surface of genus 1: the underside, up the wall outside, over the rim, down inside to the floor,
with two loops of the wall joined by the handle.
"""

import numpy as np

from vig_world.assets.designs.curves import squared_circle
from vig_world.assets.designs.topology import Loft, band, symmetric
from vig_world.assets.mugs.design import MugDesign
from vig_world.assets.mugs.handle import AROUND, RINGS, half_sizes, handle_rings, section
from vig_world.assets.mugs.wall import Profile, inside, outside, rim, underside

PART_NAMES = ("body", "rim", "inside", "handle")  # painted coats cover the first two

_COLUMNS = 44
_UNDERSIDE, _RIM, _INSIDE = 7, 4, 11
_SPANS = (5, 4, 6, 4, 3)
"""Rows of faces of the outer wall: below the lower loop, beside it, between, beside the upper one, above."""
_WALL = sum(_SPANS) + 1
_LOFT = Loft((1, 11, 22, *[_COLUMNS] * (4 + _WALL + _RIM + _INSIDE), 22, 11, 1))
_HALF = AROUND // 8  # columns of faces from a loop's middle to its side
_GATHERED = 1.5  # power by which the lowest rows, and those at the floor, gather where the wall is round
_DOWN = np.linspace(1.0, 0.0, _INSIDE) ** _GATHERED
"""Fractions of the inner wall at its rings, from the rim down."""

_LOWER, _UPPER = (_UNDERSIDE + sum(_SPANS[:count]) + _HALF for count in (1, 3))
"""Rings of the loft at the middles of the loops."""


def _loop(ring: int, sign: int) -> np.ndarray:
    """Return the loft's vertices (AROUND,) on the loop round a ring's first vertex; sign -1 for the upper."""
    across, up = (np.clip(AROUND // 4 - _away(place), -_HALF, _HALF) for place in (0, AROUND // 4))
    return _LOFT.starts[ring + sign * up] + across % _COLUMNS


def _away(place: int) -> np.ndarray:
    """Return steps (AROUND,) round the loop from each of its vertices to one of them."""
    half = AROUND // 2
    return np.abs((np.arange(AROUND) - place + half) % AROUND - half)


def _cap_vertices(ring: int) -> np.ndarray:
    """Return vertices of the loft on the loop round a ring and within it."""
    rows, columns = np.meshgrid(np.arange(-_HALF, _HALF + 1), np.arange(-_HALF, _HALF + 1))
    return (_LOFT.starts[ring + rows] + columns % _COLUMNS).ravel()


_LOOPS = (_loop(_LOWER, 1), _loop(_UPPER, -1))
_OPEN = [np.setdiff1d(_cap_vertices(ring), loop) for ring, loop in zip((_LOWER, _UPPER), _LOOPS, strict=True)]
_KEPT = np.setdiff1d(np.arange(int(_LOFT.starts[-1])), np.concatenate(_OPEN))
_NEW = np.full(int(_LOFT.starts[-1]), -1)
_NEW[_KEPT] = np.arange(len(_KEPT))


def _faces() -> np.ndarray:
    own = _LOFT.faces()
    for ring in (_LOWER, _UPPER):
        own = own[~np.isin(own, _cap_vertices(ring)).all(axis=1)]
    around = [
        _NEW[_LOOPS[0]],
        *(len(_KEPT) + np.arange(RINGS * AROUND).reshape(RINGS, AROUND)),
        _NEW[_LOOPS[1]],
    ]
    # A ring's first vertex lies at +y here; `band` has its mirror plane through it.
    rings = [np.roll(ring, -AROUND // 4) for ring in around]
    local = np.array(band(0, AROUND, AROUND, AROUND))
    tube = [
        np.concatenate([first, second])[local] for first, second in zip(rings[:-1], rings[1:], strict=True)
    ]
    tube[0] = np.array([np.roll(face, -int(np.argmax(face >= len(_KEPT)))) for face in tube[0]])
    return np.concatenate([_NEW[own], *tube]).astype(np.int32)


def _parts() -> np.ndarray:
    of_ring = np.repeat([0, 1, 2], [_UNDERSIDE + _WALL, _RIM, _INSIDE + 3])
    parts = np.repeat(of_ring, _LOFT.counts)[_KEPT]
    return np.concatenate([parts, np.full(RINGS * AROUND, 3)]).astype(np.int32)


def _mirror() -> np.ndarray:
    ring = (AROUND // 2 - np.arange(AROUND)) % AROUND
    own = (AROUND * np.arange(RINGS)[:, None] + ring).ravel()
    return np.concatenate([_NEW[_LOFT.mirror()[_KEPT]], len(_KEPT) + own]).astype(np.int32)


MUG_FACES: np.ndarray = _faces()
"""Triangles (F, 3) of every mug, counter-clockwise from outside. A face's first vertex gives its part."""

MUG_PARTS: np.ndarray = _parts()  # part of each vertex (V,), an index into PART_NAMES

MUG_MIRROR: np.ndarray = _mirror()
"""Mirror image in y of each vertex (V,): `v[MUG_MIRROR] * (1, -1, 1) == v` exactly, for every design."""

POINTS = {
    "handle": len(_KEPT) + AROUND * (RINGS // 2) + 3 * AROUND // 4,
    "rim": int(_NEW[_LOFT.starts[_UNDERSIDE + _WALL + 2] + _COLUMNS // 2]),
    "base": 0,
}
"""Vertices by name: outermost on the middle of the handle's grip, on the rim opposite, under the middle."""


def mug_vertices(design: MugDesign) -> np.ndarray:
    """Return vertices of a design, (V, 3) float32 in metres, standing on z = 0, the body's axis at x = y = 0.

    Exactly mirror symmetric in y (see MUG_MIRROR); the topology is MUG_FACES for every design.
    """
    outer, inner = outside(design), inside(design)
    rows = wall_rows(design, outer)
    floor = inner.points[0] * [[0.66, 1.0], [0.33, 1.0], [0.0, 1.0]]
    profile = np.concatenate([underside(design), outer.at(rows), rim(design), inner.at(_DOWN), floor])
    angles = _half_angles(design, outer)
    ends = np.array([design.handle_bottom, design.handle_top])
    rings = []
    for count, (radius, height) in zip(_LOFT.counts, profile, strict=True):
        angle = _columns(count, float(np.interp(height, ends, angles)))
        rings.append(_on_wall(design, angle, np.full(count, radius), np.full(count, height)))
    body = np.concatenate(rings)
    loops = []
    for upper, ring in enumerate((_LOWER, _UPPER)):
        unit = section(design.handle_squareness)
        half = half_sizes(design, bool(upper))[1] / outer.length
        place = outer.at(rows[ring - _UNDERSIDE] + (1 - 2 * upper) * half * unit[:, 1])
        loops.append(_on_wall(design, angles[upper] * unit[:, 0], *place.T))
        body[_LOOPS[upper]] = loops[-1]
    handle = handle_rings(design, outer, (loops[0], loops[1])).reshape(-1, 3)
    return symmetric(np.concatenate([body[_KEPT], handle]), MUG_MIRROR)


def wall_rows(design: MugDesign, outer: Profile) -> np.ndarray:
    """Return fractions (rings,) of the outer wall's arc length at its rings; growing for a sound design."""
    places = [0.0]
    for upper, height in enumerate((design.handle_bottom, design.handle_top)):
        middle, half = outer.fraction(height), half_sizes(design, bool(upper))[1] / outer.length
        places += [middle - half, middle + half]
    places.append(1.0)
    rows = [np.zeros(1)]
    for number, (count, low, high) in enumerate(zip(_SPANS, places[:-1], places[1:], strict=True)):
        step = np.arange(1, count + 1) / count
        rows.append(low + (high - low) * (step**_GATHERED if number == 0 else step))
    return np.concatenate(rows)


def _half_angles(design: MugDesign, outer: Profile) -> np.ndarray:
    """Return angles (2,) about the axis from the middle of the lower and upper loop to its side, radians."""
    radii = [float(outer.radius(z)) for z in (design.handle_bottom, design.handle_top)]
    widths = [half_sizes(design, upper)[0] for upper in (False, True)]
    return np.arcsin(np.minimum(0.9, np.array(widths) / np.maximum(radii, 1e-6)))


def _columns(count: int, half_angle: float) -> np.ndarray:
    """Return angles (count,) about the axis of a ring's vertices, by the handle as far apart as its width."""
    column = np.arange(count) * (_COLUMNS // count)
    column = np.where(column > _COLUMNS // 2, column - _COLUMNS, column)
    rest = (np.abs(column) - _HALF) / (_COLUMNS // 2 - _HALF)
    angle = np.where(
        rest < 0.0, half_angle * np.abs(column) / _HALF, half_angle + (np.pi - half_angle) * rest
    )
    return np.sign(column) * angle


def _on_wall(design: MugDesign, angle: np.ndarray, radius: np.ndarray, height: np.ndarray) -> np.ndarray:
    """Return points (N, 3) at angles about the axis, of sections of a radius, (N,) each."""
    reach = radius * squared_circle(angle, design.squareness)
    return np.stack([reach * np.cos(angle), reach * np.sin(angle), height], axis=1)
