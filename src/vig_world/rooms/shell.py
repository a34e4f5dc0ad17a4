"""Floor, walls, ceiling, skirting: a room's shell, seen from inside only. Texture coordinates are metres."""

from dataclasses import dataclass

import numpy as np

from vig_world.assets.shapes import move_mesh
from vig_world.assets.textures import texture
from vig_world.assets.things import Material
from vig_world.mesh import Mesh

Array = np.ndarray
Part = tuple[Mesh, Material]
Hole = tuple[float, float, float, float]  # x0, y0, x1, y1 of an opening in a wall


@dataclass(frozen=True)
class Wall:
    """A side of the room: its start (x, y), the direction (radians) along it, inside on the left, its length.

    Its frame has x along it, y into the room and z up; `corners`: whether the room's corners at its start and
    end are convex.
    """

    start: tuple[float, float]
    angle: float
    length: float
    corners: tuple[bool, bool]

    def at(self, along: float, inside: float) -> Array:
        """Return the point (x, y) of the room at a place of the wall's frame."""
        c, s = np.cos(self.angle), np.sin(self.angle)
        return np.array(self.start) + [c * along - s * inside, s * along + c * inside]

    def place_mesh(self, mesh: Mesh) -> Mesh:
        """Return a mesh of the wall's frame in the room's."""
        return move_mesh(mesh, (*self.start, 0.0), self.angle)


@dataclass(frozen=True)
class Opening:
    """A door or window in wall number `wall`: from `left` to `right` along it, from `low` to `high`."""

    kind: str
    wall: int
    left: float
    right: float
    low: float
    high: float


def walls_of(outline: Array) -> list[Wall]:
    """Return the sides of a floor whose corners (N, 2) go counter-clockwise."""
    ahead = np.roll(outline, -1, 0) - outline
    turn = np.roll(ahead, 1, 0)
    convex = turn[:, 0] * ahead[:, 1] - turn[:, 1] * ahead[:, 0] > 0
    return [
        Wall(
            (float(a[0]), float(a[1])),
            float(np.arctan2(d[1], d[0])),
            float(np.hypot(*d)),
            (bool(convex[k]), bool(convex[(k + 1) % len(outline)])),
        )
        for k, (a, d) in enumerate(zip(outline, ahead, strict=True))
    ]


def cells(low: tuple[float, float], high: tuple[float, float], holes: list[Hole]) -> list[Hole]:
    """Return rectangles that cover the rectangle low..high but for its holes, all on one grid of lines."""
    xs = sorted({low[0], high[0], *(hole[0] for hole in holes), *(hole[2] for hole in holes)})
    ys = sorted({low[1], high[1], *(hole[1] for hole in holes), *(hole[3] for hole in holes)})
    result = []
    for a, c in zip(xs[:-1], xs[1:], strict=True):
        for b, d in zip(ys[:-1], ys[1:], strict=True):
            x, y = (a + c) / 2, (b + d) / 2
            if not any(h[0] < x < h[2] and h[1] < y < h[3] for h in holes):
                result.append((a, b, c, d))
    return result


def quads(corners: list[list[tuple[float, float, float]]], uv: Array) -> Mesh:
    """Return separate quads, each (4, 3) counter-clockwise as seen; uv (N, 4, 2)."""
    points = np.array(corners, np.float32)
    faces = np.array([[0, 1, 2], [0, 2, 3]])[None] + 4 * np.arange(len(points))[:, None, None]
    return Mesh(
        points.reshape(-1, 3),
        faces.reshape(-1, 3).astype(np.int32),
        np.asarray(uv, np.float32).reshape(-1, 2),
    )


def _level(outline: Array, z: float, up: bool) -> Mesh:
    xs, ys = np.unique(outline[:, 0]), np.unique(outline[:, 1])
    corners = []
    for a, c in zip(xs[:-1], xs[1:], strict=True):
        for b, d in zip(ys[:-1], ys[1:], strict=True):
            if inside(outline, np.array([[(a + c) / 2, (b + d) / 2]]))[0]:
                quad = [(a, b, z), (c, b, z), (c, d, z), (a, d, z)]
                corners.append(quad if up else quad[::-1])
    return quads(corners, np.array(corners)[:, :, :2])


def inside(outline: Array, points: Array) -> Array:
    """Return which points (M, 2) lie in a polygon (N, 2)."""
    a, b = outline[None], np.roll(outline, -1, 0)[None]
    x, y = points[:, None, 0], points[:, None, 1]
    spans = (a[..., 1] > y) != (b[..., 1] > y)
    rise = np.where(b[..., 1] == a[..., 1], 1.0, b[..., 1] - a[..., 1])
    crossing = a[..., 0] + (y - a[..., 1]) * (b[..., 0] - a[..., 0]) / rise
    return (np.sum(spans & (x < crossing), axis=1) % 2).astype(bool)


def _wall(wall: Wall, height: float, openings: list[Opening], depth: float) -> Mesh:
    """Return a wall with its openings, and the sides and heads of its windows' recesses."""
    holes = [(o.left, o.low, o.right, o.high) for o in openings]
    corners = [
        [(c, 0.0, b), (a, 0.0, b), (a, 0.0, d), (c, 0.0, d)]
        for a, b, c, d in cells((0, 0), (wall.length, height), holes)
    ]
    uv = [[(x, z) for x, _, z in quad] for quad in corners]
    for o in openings:
        if o.kind != "window":
            continue
        d, (a, b, c, e) = -depth, (o.left, o.low, o.right, o.high)
        recess = [
            [(a, 0.0, b), (a, d, b), (a, d, e), (a, 0.0, e)],
            [(c, d, b), (c, 0.0, b), (c, 0.0, e), (c, d, e)],
            [(a, d, e), (c, d, e), (c, 0.0, e), (a, 0.0, e)],
        ]
        corners += recess
        uv += [[(x + y, z) for x, y, z in quad] for quad in recess[:2]]
        uv += [[(x, z + y) for x, y, z in recess[2]]]
    return wall.place_mesh(quads(corners, np.array(uv)))


def _moulding(wall: Wall, profile: list[tuple[float, float]], gaps: list[Opening]) -> list[Mesh]:
    """Return a strip along a wall, mitred at its corners and cut at the gaps.

    profile: (y, z) points, from below to above as seen from the room.
    """
    spots = sorted((o.left - 0.06, o.right + 0.06) for o in gaps)
    starts = [0.0, *(right for _, right in spots)]
    ends = [*(left for left, _ in spots), wall.length]
    result = []
    for start, end in zip(starts, ends, strict=True):
        if end - start < 0.05:
            continue
        first = (1 if wall.corners[0] else -1) if start == 0 else 0
        last = (-1 if wall.corners[1] else 1) if end == wall.length else 0
        corners, uv, along = [], [], 0.0
        for (ya, za), (yb, zb) in zip(profile[:-1], profile[1:], strict=True):
            a, b = (end + last * ya, ya, za), (start + first * ya, ya, za)
            c, d = (start + first * yb, yb, zb), (end + last * yb, yb, zb)
            corners.append([a, b, c, d])
            step = float(np.hypot(yb - ya, zb - za))
            uv.append([(along, a[0]), (along, b[0]), (along + step, c[0]), (along + step, d[0])])
            along += step
        for at, flip in ((start, False), (end, True)):
            if at not in (0.0, wall.length):
                cap = [(at, y, z) for y, z in (profile[0], profile[1], profile[-1], (0.0, profile[0][1]))]
                corners.append(cap[::-1] if not flip else cap)
                uv.append([(y, z) for _, y, z in corners[-1]])
        result.append(wall.place_mesh(quads(corners, np.array(uv))))
    return result


def shell(
    rng: np.random.Generator,
    outline: Array,
    height: float,
    openings: list[Opening],
    depth: float,
    paint: Material,
) -> list[Part]:
    """Build the shell of a room.

    Args:
        depth: Depth of the windows' recesses.
        paint: Paint of skirting and cornice.
    """

    def stand_in(kind: str, stuff: str, slot: str) -> Material:
        return Material(texture(kind, rng, 32), stuff, 0.8, slot)

    walls = walls_of(outline)
    wall = stand_in("paint", "paint", "wall")
    white = Material(np.full((1, 1, 3), 0.8, np.float32), "paint", 0.9, "ceiling")
    parts = [
        (_level(outline, 0.0, True), stand_in("wood", "wood", "floor")),
        (_level(outline, height, False), white),
    ]
    tall, thick = float(rng.uniform(0.06, 0.15)), float(rng.uniform(0.012, 0.018))
    profile = [
        (thick, 0.0),
        (thick, 0.85 * tall),
        (0.5 * thick, 0.95 * tall),
        (0.5 * thick, tall),
        (0.0, tall),
    ]
    cornice = float(rng.uniform(0.04, 0.1)) if rng.uniform() < 0.4 else 0.0
    drop = [(0.0, -1.0), (0.12, -0.9), (0.35, -0.55), (0.75, -0.2), (1.0, -0.12), (1.0, 0.0)]
    for number, side in enumerate(walls):
        own = [o for o in openings if o.wall == number]
        parts.append((_wall(side, height, own, depth), wall))
        parts += [(mesh, paint) for mesh in _moulding(side, profile, [o for o in own if o.kind == "door"])]
        if cornice:
            crown = [(cornice * y, height + cornice * z) for y, z in drop]
            parts += [(mesh, paint) for mesh in _moulding(side, crown, [])]
    return parts
