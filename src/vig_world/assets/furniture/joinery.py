"""Assembles furniture from boards, slabs, posts and cushions; texture coordinates are metres.

Wood's grain runs along v, so v follows the longest side of a board. Meshes are closed and face outward.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from vig_world.assets.furniture.furniture import Furniture, Support
from vig_world.assets.props.material import Material
from vig_world.assets.props.shapes import box, moved, revolve, tube
from vig_world.mesh import Mesh

Array = np.ndarray
Profile = Sequence[tuple[float, float]]
Point = tuple[float, float, float]


@lru_cache(maxsize=2)
def _cube(bevelled: bool) -> tuple[Array, Array, Array, Array]:
    """Signs (N, 3), cut axes (N, 3) in 0/1 and facing axis (N,) of a box's vertices, and its triangles."""
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
    """Boxes between corners low and high (N, 3) as one mesh; shift (N, 2) moves each one's texture."""
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


def board(size: ArrayLike, bevel: float = 0.0) -> Mesh:
    """A box (x, y, z) on z = 0, centred, with its edges cut off by `bevel`."""
    x, y, z = np.asarray(size, np.float64)
    return boards([[-x / 2, -y / 2, 0]], [[x / 2, y / 2, z]], bevel, [[x / 2, y / 2]])


@lru_cache(maxsize=16)
def _corners(corner: int) -> tuple[Array, Array]:
    """A rounded rectangle's points, counter-clockwise: their corners' signs (N, 2) and directions (N, 2)."""
    quarters = np.array([-1, 0, 1, 2]) * np.pi / 2
    steps = np.linspace(0, np.pi / 2, corner + 1) if corner else np.array([0.0, np.pi / 2])
    angle = (quarters[:, None] + steps).ravel()
    signs = np.array([[1.0, -1.0], [1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0]]).repeat(len(steps), 0)
    return signs, np.stack([np.cos(angle), np.sin(angle)], -1)


@lru_cache(maxsize=256)
def _ring_faces(lengths: tuple[int, ...], n: int, sharp: bool, soft: bool) -> Array:
    """Triangles between the rings of n + 1 vertices of each run, and of the two ends."""
    faces, start = [], 0
    for length in lengths:
        r, c = np.meshgrid(np.arange(length - 1), np.arange(n), indexing="ij")
        if sharp:
            r, c = r[:, 1::2], c[:, 1::2]  # the sides; between them the corners' two points coincide
        a = start + r * (n + 1) + c
        faces.append(np.stack([a, a + 1, a + n + 2, a, a + n + 2, a + n + 1], -1).reshape(-1, 3))
        start += length * (n + 1)
    k = np.arange(1, n - 1)
    fan = np.stack([np.zeros_like(k), k, k + 1], -1)
    bottom, top = (0, start - n - 1) if soft else (start, start + n)
    return np.concatenate([*faces, bottom + fan[:, ::-1], top + fan]).astype(np.int32)


def slab(
    half: ArrayLike, radius: float, runs: Sequence[Profile], corner: int = 3, soft: bool = False
) -> Mesh:
    """A body over a rectangle with rounded corners, closed by flat ends.

    Args:
        half: Half its extents in x and y.
        radius: Radius of its corners, up to the smaller half (a round or oval body).
        runs: From the bottom's rim to the top's, each a list of (inset, z) shaded smoothly, with sharp edges
            between runs.
        corner: Pieces per quarter circle, 0 for sharp corners.
        soft: The ends join smoothly too.
    """
    half = np.asarray(half, np.float64)
    inset, z = np.array([point for run in runs for point in run], np.float64).T
    signs, outward = _corners(corner)
    reach = np.maximum(half - inset[:, None], 1e-4)
    rounded = np.clip(radius - inset, 0.0, reach.min(1))
    flat = signs * (reach - rounded[:, None])[:, None] + rounded[:, None, None] * outward
    rows, n = flat.shape[:2]
    rings = np.empty((rows, n + 1, 3))
    rings[:, :n, :2], rings[:, n, :2], rings[:, :, 2] = flat, flat[:, 0], z[:, None]
    uv = np.empty((rows, n + 1, 2))
    along = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(inset), np.diff(z)))])
    if soft:  # laid flat round the upper end
        uv[:, :n] = flat[-1] + outward * (along[-1] - along)[:, None, None]
        uv[:, n] = uv[:, 0]
    else:
        widest = rings[int(np.argmin(inset)), :, :2]
        uv[:, 1:, 1] = np.cumsum(np.hypot(*(widest[1:] - widest[:-1]).T))
        uv[:, 0, 1] = 0.0
        uv[:, :, 0] = along[:, None]
    points, texture = rings.reshape(-1, 3), uv.reshape(-1, 2)
    if not soft:
        ends = rings[[0, -1], :n].reshape(-1, 3)
        points = np.concatenate([points, ends])
        texture = np.concatenate([texture, ends[:, [1, 0]] if half[0] > half[1] else ends[:, :2]])
    triangles = _ring_faces(tuple(len(run) for run in runs), n, corner == 0, soft)
    return _without_empty(points, triangles, texture)


def _without_empty(points: Array, triangles: Array, uv: Array) -> Mesh:
    """A mesh of the triangles that have an area, and of the vertices they use."""
    a, b, c = points[triangles[:, 0]], points[triangles[:, 1]], points[triangles[:, 2]]
    p, q = b - a, c - a
    area = (p * p).sum(1) * (q * q).sum(1) - (p * q).sum(1) ** 2
    not_empty = area > 1e-18
    if not not_empty.all():
        triangles = triangles[not_empty]
    used = np.zeros(len(points), bool)
    used[triangles] = True
    if not used.all():
        triangles = (np.cumsum(used) - 1)[triangles]
        points, uv = points[used], uv[used]
    return Mesh(points.astype(np.float32), triangles.astype(np.int32), uv.astype(np.float32))


def rounding(inset: float, low: float, high: float, pieces: int) -> list[tuple[float, float]]:
    """A quarter round from the upright side at `low` to the level at `high`, drawn in by `inset`."""
    t = np.linspace(0, np.pi / 2, pieces + 1)
    return [(float(inset * (1 - np.cos(a))), float(low + (high - low) * np.sin(a))) for a in t]


def cushion(half: ArrayLike, height: float, radius: float, corner: int = 2) -> Mesh:
    """A soft block with a flat middle, on z = 0; `radius` of its corners and, below it, of its edges."""
    edge = min(radius, 0.5 * height)
    up = rounding(edge, height - edge, height, 2)
    down = [(inset, height - z) for inset, z in up[::-1]]
    return slab(half, radius, [[*down, *up]], corner, soft=True)


def turned_post(profile: ArrayLike, segments: int = 10) -> Mesh:
    """A surface of revolution (see `revolve`) with its texture in metres."""
    mesh = revolve(np.asarray(profile, float), segments)
    points = np.asarray(profile, float)
    size = [np.pi * points[:, 0].max(), np.hypot(*np.diff(points, axis=0).T).sum()]
    assert mesh.uv is not None
    return Mesh(mesh.vertices, mesh.faces, (mesh.uv * size).astype(np.float32))


def rod(path: ArrayLike, radius: float, sides: int = 6, up: ArrayLike = (0.0, 0.0, 1.0)) -> Mesh:
    """A tube (see `tube`) with its texture in metres."""
    points = np.asarray(path, float)
    mesh = tube(points, radius, sides, up)
    assert mesh.uv is not None
    length = np.linalg.norm(np.diff(points, axis=0), axis=1).sum()
    return Mesh(mesh.vertices, mesh.faces, (mesh.uv * [np.pi * radius, length]).astype(np.float32))


def stick(start: ArrayLike, end: ArrayLike, radius: float, sides: int = 6) -> Mesh:
    """A straight round bar between two points."""
    a, b = np.asarray(start, np.float64), np.asarray(end, np.float64)
    away = b - a
    length = float(np.sqrt(away @ away))
    away /= length
    spare = np.eye(3)[int(np.argmin(np.abs(away)))]
    across = np.array(
        [
            away[1] * spare[2] - away[2] * spare[1],
            away[2] * spare[0] - away[0] * spare[2],
            away[0] * spare[1] - away[1] * spare[0],
        ]
    )
    across /= np.sqrt(across @ across)
    over = np.array(
        [
            away[1] * across[2] - away[2] * across[1],
            away[2] * across[0] - away[0] * across[2],
            away[0] * across[1] - away[1] * across[0],
        ]
    )
    angle = np.arange(sides + 1) * (2 * np.pi / sides)
    ring = radius * (np.cos(angle)[:, None] * across + np.sin(angle)[:, None] * over)
    points = np.concatenate([a + ring, b + ring, a + ring[:-1], b + ring[:-1]])
    u = radius * angle
    uv = np.zeros((len(points), 2))
    uv[: sides + 1, 0] = uv[sides + 1 : 2 * sides + 2, 0] = u
    uv[sides + 1 : 2 * sides + 2, 1] = length
    caps = radius * np.stack([np.cos(angle), np.sin(angle)], -1)[:-1]
    uv[2 * sides + 2 :] = np.concatenate([caps, caps])
    faces = _ring_faces((2,), sides, False, False)
    return Mesh(points.astype(np.float32), faces, uv.astype(np.float32))


def joined(meshes: Sequence[Mesh]) -> Mesh:
    """Meshes with texture coordinates as one."""
    if len(meshes) == 1:
        return meshes[0]
    starts = np.cumsum([0] + [len(mesh.vertices) for mesh in meshes[:-1]])
    return Mesh(
        np.concatenate([mesh.vertices for mesh in meshes]),
        np.concatenate([mesh.faces + start for mesh, start in zip(meshes, starts, strict=True)]).astype(
            np.int32
        ),
        np.concatenate([mesh.uv for mesh in meshes if mesh.uv is not None]),
    )


class Joinery:
    """A piece of furniture under construction: parts by material, and its supports, all in one frame."""

    def __init__(self, rng: np.random.Generator) -> None:
        self.rng = rng
        self._materials: dict[int, Material] = {}
        self._meshes: dict[int, list[Mesh]] = {}
        self._boards: dict[tuple[int, float], list[tuple[Point, Point]]] = {}
        self._supports: list[Support] = []

    def board(self, stuff: Material, low: Point, high: Point, bevel: float = 0.0) -> None:
        """A box between two corners, its edges cut off by `bevel`; each has its own place in the texture."""
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
        """A mesh, tilted about x, turned about z and shifted."""
        self._materials[id(stuff)] = stuff
        self._meshes.setdefault(id(stuff), []).append(moved(mesh, offset, turn, tilt))

    def support(
        self,
        zone: str,
        low: tuple[float, float],
        high: tuple[float, float],
        z: float,
        clearance: float = float("inf"),
        behind: float = float("inf"),
    ) -> None:
        """A level rectangle between two corners at height z; one too small for any object is left out."""
        half = (float(high[0] - low[0]) / 2, float(high[1] - low[1]) / 2)
        if min(half) < 0.06:
            return
        centre = (float(low[0] + high[0]) / 2, float(low[1] + high[1]) / 2, z)
        self._supports.append(Support(zone, centre, half, 0.0, clearance, behind))

    def parts(self) -> list[tuple[Mesh, Material]]:
        """All parts so far, one mesh per material."""
        meshes = {key: list(value) for key, value in self._meshes.items()}
        for (key, bevel), corners in self._boards.items():
            low, high = np.array(corners, np.float64).transpose(1, 0, 2)
            shift = self.rng.uniform(0, 1, (len(low), 2))
            meshes.setdefault(key, []).append(boards(low, high, bevel, shift))
        return [(joined(value), self._materials[key]) for key, value in meshes.items()]

    def done(self, family: str) -> Furniture:
        """The finished piece, standing on z = 0, its bounding box centred."""
        parts = self.parts()
        low = np.min([mesh.vertices.min(0) for mesh, _ in parts], axis=0).astype(float)
        high = np.max([mesh.vertices.max(0) for mesh, _ in parts], axis=0).astype(float)
        shift = -np.array([(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, low[2]])
        x, y, z = (float(value) for value in shift)
        return Furniture(
            family,
            tuple((moved(mesh, shift), stuff) for mesh, stuff in parts),
            tuple(support.moved((x, y, z), 0.0) for support in self._supports),
        )
