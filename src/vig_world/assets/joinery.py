"""Assembles built-in parts of rooms from boards and rods; texture coordinates are metres.

Wood's grain runs along v, so v follows the longest side of a board. Meshes are closed and face outward.
"""

from collections.abc import Iterable, Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from vig_world.assets.shapes import box, move_mesh, tube
from vig_world.assets.things import Material
from vig_world.mesh import Mesh, stack_meshes

Array = np.ndarray
Point = tuple[float, float, float]


@lru_cache(maxsize=2)
def _cube(bevelled: bool) -> tuple[Array, Array, Array, Array]:
    """Return signs (N, 3), cut axes (N, 3) in 0/1 and facing axis (N,) of a box's vertices, and triangles."""
    mesh = box((2.0, 2.0, 2.0), 0.2 if bevelled else 0.0)
    points = mesh.vertices - [0, 0, 1]
    polygons = [range(k, k + 4) for k in range(0, 72 if bevelled else 24, 4)]
    polygons += [range(k, k + 3) for k in range(72, 96, 3)] if bevelled else []
    axis = np.zeros(len(points), int)
    for polygon in polygons:
        mean = np.abs(points[list(polygon)].mean(0)) + [0.02, 0.0, 0.04]
        axis[list(polygon)] = int(np.argmax(mean))
    return np.sign(points), (np.abs(points) < 0.9).astype(float), axis, mesh.faces


def boards(low: ArrayLike, high: ArrayLike, bevel: float, shift: ArrayLike) -> Mesh:
    """Return boxes between corners low and high (N, 3) as one mesh; shift (N, 2) moves each one's texture."""
    low, high = np.asarray(low, np.float64), np.asarray(high, np.float64)
    signs, cuts, axis, faces = _cube(bevel > 0)
    half = (high - low) / 2
    cut = np.minimum(bevel, 0.45 * (high - low).min(1))[:, None, None]
    local = signs * (half[:, None] - cut * cuts)
    others = np.array([[1, 2], [0, 2], [0, 1]])
    sizes = half[:, others]
    swapped = sizes[:, :, 0] > sizes[:, :, 1]  # the longer of the two is v
    pairs = np.where(swapped[:, :, None], others[:, ::-1], others)[:, axis]
    uv = np.take_along_axis(local, pairs, 2) + np.asarray(shift, np.float64)[:, None]
    count = signs.shape[0]
    triangles = faces[None] + count * np.arange(len(low))[:, None, None]
    points = local + (low + half)[:, None]
    return Mesh(
        points.reshape(-1, 3).astype(np.float32),
        triangles.reshape(-1, 3).astype(np.int32),
        uv.reshape(-1, 2).astype(np.float32),
    )


def rod(path: ArrayLike, radius: float, sides: int = 6, up: ArrayLike = (0.0, 0.0, 1.0)) -> Mesh:
    """Return a tube (see `tube`) with its texture in metres."""
    points = np.asarray(path, float)
    mesh = tube(points, radius, sides, up)
    assert mesh.uv is not None
    length = np.linalg.norm(np.diff(points, axis=0), axis=1).sum()
    return Mesh(mesh.vertices, mesh.faces, (mesh.uv * [np.pi * radius, length]).astype(np.float32))


def stick(start: ArrayLike, end: ArrayLike, radius: float, sides: int = 6) -> Mesh:
    """Return a straight round bar between two points."""
    path = np.asarray([start, end], np.float64)
    return rod(path, radius, sides, np.eye(3)[int(np.argmin(np.abs(path[1] - path[0])))])


def join_meshes(meshes: Sequence[Mesh]) -> Mesh:
    """Return meshes with texture coordinates as one."""
    if len(meshes) == 1:
        return meshes[0]
    vertices, faces = stack_meshes(meshes)
    uv = np.concatenate([mesh.uv for mesh in meshes if mesh.uv is not None])
    return Mesh(vertices, faces.astype(np.int32), uv)


def by_finish(parts: Iterable[tuple[Mesh, Material]]) -> list[tuple[Mesh, Material]]:
    """Return one part for each slot, and for each material without one, in the order of first use."""
    groups: dict[str | int, tuple[Material, list[Mesh]]] = {}
    for mesh, stuff in parts:
        groups.setdefault(stuff.slot or id(stuff), (stuff, []))[1].append(mesh)
    return [(join_meshes(meshes), stuff) for stuff, meshes in groups.values()]


class Joinery:
    """A thing under construction: parts by material, in one frame."""

    def __init__(self, rng: np.random.Generator) -> None:
        self.rng = rng
        self._materials: dict[int, Material] = {}
        self._meshes: dict[int, list[Mesh]] = {}
        self._boards: dict[tuple[int, float], list[tuple[Point, Point]]] = {}

    def board(self, stuff: Material, low: Point, high: Point, bevel: float = 0.0) -> None:
        """Add a box between two corners, edges cut off by `bevel`; each has its own place in the texture."""
        self._materials[id(stuff)] = stuff
        self._boards.setdefault((id(stuff), bevel), []).append((low, high))

    def add(
        self,
        stuff: Material,
        mesh: Mesh,
        offset: ArrayLike = (0.0, 0.0, 0.0),
        turn: float = 0.0,
        tilt: float = 0.0,
    ) -> None:
        """Add a mesh, tilted about x, turned about z and shifted."""
        self._materials[id(stuff)] = stuff
        self._meshes.setdefault(id(stuff), []).append(move_mesh(mesh, offset, turn, tilt))

    def parts(self) -> list[tuple[Mesh, Material]]:
        """Return all parts so far, one mesh per material."""
        meshes = {key: list(value) for key, value in self._meshes.items()}
        for (key, bevel), corners in self._boards.items():
            low, high = np.array(corners, np.float64).transpose(1, 0, 2)
            shift = self.rng.uniform(0, 1, (len(low), 2))
            meshes.setdefault(key, []).append(boards(low, high, bevel, shift))
        return [(join_meshes(value), self._materials[key]) for key, value in meshes.items()]
