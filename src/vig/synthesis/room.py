"""Draws a room round the object, and gives its surfaces as meshes."""

from __future__ import annotations

import numpy as np

from vig.scene import Mesh
from vig.synthesis import assets
from vig.synthesis.spec import Room, Split, Surface

TABLE_KINDS = ("wood", "wood", "marble", "cloth", "paint", "tiles", "checker", "terrazzo", "speckle")
FLOOR_KINDS = ("wood", "tiles", "checker", "cloth", "terrazzo", "marble", "speckle")
WALL_KINDS = ("paint", "paint", "wallpaper", "brick", "wood", "tiles", "speckle")


def draw_room(rng: np.random.Generator, split: Split, azimuth: float, vertices: np.ndarray) -> Room:
    """A room whose first wall is behind the object as seen from `azimuth`, at a random heading.

    vertices: (V, 3) of the object, which stays clear of the walls and on the table. The eye, 0.4 m away,
    is always inside.
    """
    heading = azimuth + np.pi / 2 + rng.uniform(-np.pi / 4, np.pi / 4)
    angle = heading + np.arange(4) * (np.pi / 2)
    reach = (vertices[:, :2] @ np.stack([np.cos(angle), np.sin(angle)])).max(0) + 0.02
    behind = np.exp(rng.uniform(np.log(0.25), np.log(2.5)))
    corner = int(rng.choice([1, 3]))
    walls = np.array([behind, 0, 0, 0]) + rng.uniform([0, 1.2, 1.5, 1.2], [0.01, 3.5, 4.0, 3.5])
    if rng.uniform() < 0.5:
        walls[corner] = rng.uniform(0.42, 1.2)
    walls = np.maximum(walls, reach)
    on_table = rng.uniform() < 0.65
    table: tuple[float, ...] = ()
    if on_table:
        ends = rng.uniform([0.2, 0.25, 0.45, 0.25], [0.9, 1.0, 0.9, 1.0])
        if rng.uniform() < 0.4:
            ends[0] = walls[0]
        table = tuple(np.minimum(np.maximum(ends, reach), walls - 0.001).tolist())
    floor_z = -rng.uniform(0.65, 0.9) if on_table else 0.0
    return Room(
        support="table" if on_table else "floor",
        heading=float(heading),
        walls=tuple(walls.tolist()),
        table=table,
        thickness=rng.uniform(0.015, 0.05),
        floor_z=floor_z,
        ceiling_z=floor_z + rng.uniform(2.3, 3.0),
        floor=_finish(rng, split, FLOOR_KINDS, 0.4, 1.2),
        wall=_finish(rng, split, WALL_KINDS, 0.4, 1.2),
        table_top=_finish(rng, split, TABLE_KINDS, 0.25, 0.7),
    )


def _finish(
    rng: np.random.Generator, split: Split, kinds: tuple[str, ...], low: float, high: float
) -> Surface:
    kind = str(rng.choice(kinds))
    return Surface(kind, int(rng.integers(assets.SURFACES_PER_KIND[split])), rng.uniform(low, high))


def room_meshes(room: Room) -> list[tuple[str, Mesh, Surface]]:
    """The room's surfaces in the world, each with its name and finish; uv in repeats of the texture."""
    x, y = room.directions()[0], room.directions()[1]
    frame = np.array([[*x, 0], [*y, 0], [0, 0, 1]])
    front, left, back, right = room.walls
    low, high = np.array([-back, -right, room.floor_z]), np.array([front, left, room.ceiling_z])
    faces = _box_faces(low, high)
    inside = {"wall": [0, 1, 2, 3], "floor": [4], "ceiling": [5]}
    finishes = {"wall": room.wall, "floor": room.floor, "ceiling": Surface("paint", 0, 1.0)}
    result = [
        (name, _mesh([faces[i][::-1] for i in sides], frame, finishes[name].metres), finishes[name])
        for name, sides in inside.items()
    ]
    if room.table:
        front, left, back, right = room.table
        top = _box_faces(np.array([-back, -right, -room.thickness]), np.array([front, left, 0.0]))
        result.append(("table", _mesh(top, frame, room.table_top.metres), room.table_top))
    return result


def _box_faces(low: np.ndarray, high: np.ndarray) -> list[np.ndarray]:
    """Six quads (4, 3), counter-clockwise from outside: -x, +x, -y, +y, bottom, top."""
    quads = []
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        for side, end in ((-1, low), (1, high)):
            corners = np.zeros((4, 3))
            corners[:, axis] = end[axis]
            corners[:, u] = [low[u], high[u], high[u], low[u]]
            corners[:, v] = [low[v], low[v], high[v], high[v]]
            quads.append(corners if side > 0 else corners[::-1])
    return quads


def _mesh(quads: list[np.ndarray], frame: np.ndarray, metres: float) -> Mesh:
    """Quads in the room's frame as a world mesh; uv in metres along each quad's own axes, over `metres`."""
    vertices = np.concatenate(quads)
    uv = []
    for quad in quads:
        axis = int(np.argmin(np.ptp(quad, axis=0)))
        uv.append(quad[:, [[1, 2], [0, 2], [0, 1]][axis]])
    faces = np.array([[0, 1, 2], [0, 2, 3]])[None] + 4 * np.arange(len(quads))[:, None, None]
    return Mesh(
        (vertices @ frame).astype(np.float32),
        faces.reshape(-1, 3).astype(np.int32),
        (np.concatenate(uv) / metres).astype(np.float32),
    )
