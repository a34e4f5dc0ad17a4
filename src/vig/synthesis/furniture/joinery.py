"""Puts furniture together out of boards, slabs, posts and cushions; texture coordinates are metres.

Wood's grain runs along v, so v follows the longest side of a board. Meshes are closed and face outward.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from vig.scene import Mesh
from vig.synthesis.furniture.furniture import Furniture, Support
from vig.synthesis.props.material import Material
from vig.synthesis.props.shapes import box, moved, revolve, tube

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


def _outline(half: Array, radius: float, inset: float, corner: int) -> tuple[Array, Array]:
    """A rectangle with rounded corners, counter-clockwise: points (N, 2) and outward directions (N, 2).

    corner: pieces of each quarter circle; 0 makes sharp corners, whose points come twice.
    """
    half = np.maximum(half - inset, 1e-4)
    radius = float(np.clip(radius - inset, 0.0, half.min()))
    quarters = np.array([-1, 0, 1, 2]) * np.pi / 2
    steps = np.linspace(0, np.pi / 2, corner + 1) if corner else np.array([0.0, np.pi / 2])
    angle = (quarters[:, None] + steps).ravel()
    signs = np.array([[1, -1], [1, 1], [-1, 1], [-1, -1]]).repeat(len(steps), 0)
    outward = np.stack([np.cos(angle), np.sin(angle)], -1)
    return signs * (half - radius) + radius * outward, outward


def slab(
    half: ArrayLike, radius: float, runs: Sequence[Profile], corner: int = 3, soft: bool = False
) -> Mesh:
    """A body over a rectangle with rounded corners, closed by flat ends.

    half: half its extents in x and y; radius: of its corners, up to the smaller half (a round or oval body).
    runs: from the bottom's rim to the top's, each a list of (inset, z) shaded smoothly, with sharp edges
    between runs. corner: pieces per quarter circle, 0 for sharp corners. soft: the ends join smoothly too.
    """
    half = np.asarray(half, np.float64)
    points: list[Array] = []
    uv: list[Array] = []
    faces: list[Array] = []
    total = 0
    turned = half[0] > half[1]
    rings: list[Array] = []
    for run in runs:
        sections = [_outline(half, radius, inset, corner) for inset, _ in run]
        n = len(sections[0][0])
        flat = np.array([section for section, _ in sections])
        z = np.array([[height] for _, height in run])
        along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(np.asarray(run, float), axis=0).T))])
        closed = np.concatenate([flat, flat[:, :1]], 1)
        around = np.cumsum(np.linalg.norm(np.diff(closed[0], axis=0), axis=1))
        around = np.concatenate([[0.0], around])
        if soft:
            outward = np.concatenate([sections[0][1], sections[0][1][:1]])
            texture = closed + outward * z[:, None]
        else:
            texture = np.stack(np.broadcast_arrays(along[:, None], around[None]), -1)
        ring = np.concatenate([closed, np.broadcast_to(z[:, None], (*closed.shape[:2], 1))], -1)
        r, c = np.meshgrid(np.arange(len(run) - 1), np.arange(n), indexing="ij")
        if corner == 0:
            r, c = r[:, 1::2], c[:, 1::2]  # the sides; between them the corners' two points coincide
        a = total + r * (n + 1) + c
        quads = np.stack([a, a + 1, a + n + 2, a, a + n + 2, a + n + 1], -1)
        faces.append(quads.reshape(-1, 3))
        points.append(ring.reshape(-1, 3))
        uv.append(texture.reshape(-1, 2))
        rings += [total + np.arange(n), total + (len(run) - 1) * (n + 1) + np.arange(n)]
        total += ring.shape[0] * ring.shape[1]
    for ring, upward in ((rings[0], False), (rings[-1], True)):
        rim = np.concatenate(points)[ring]
        if not soft:
            points.append(rim)
            uv.append(rim[:, [1, 0]] if turned else rim[:, :2])
            ring, total = total + np.arange(len(rim)), total + len(rim)
        k = np.arange(1, len(ring) - 1)
        fan = np.stack([np.zeros_like(k), k, k + 1], -1)
        faces.append(ring[fan] if upward else ring[fan[:, ::-1]])
    vertices = np.concatenate(points)
    triangles = np.concatenate(faces)
    a, b, c = (vertices[triangles[:, i]] for i in range(3))
    kept = (np.cross(b - a, c - a) ** 2).sum(1) > 1e-18
    used, triangles = np.unique(triangles[kept], return_inverse=True)
    return Mesh(
        vertices[used].astype(np.float32),
        triangles.reshape(-1, 3).astype(np.int32),
        np.concatenate(uv)[used].astype(np.float32),
    )


def rounding(inset: float, low: float, high: float, pieces: int) -> list[tuple[float, float]]:
    """A quarter round from the upright side at `low` to the level at `high`, drawn in by `inset`."""
    t = np.linspace(0, np.pi / 2, pieces + 1)
    return [(float(inset * (1 - np.cos(a))), float(low + (high - low) * np.sin(a))) for a in t]


def cushion(half: ArrayLike, height: float, radius: float, corner: int = 3) -> Mesh:
    """A soft block with a flat middle, on z = 0; `radius` of its corners and, below it, of its edges."""
    edge = min(radius, 0.5 * height)
    up = rounding(edge, height - edge, height, 2)
    down = [(inset, height - z) for inset, z in up[::-1]]
    return slab(half, radius, [[*down, *up]], corner, soft=True)


def turned_post(profile: ArrayLike, segments: int = 10) -> Mesh:
    """A surface of revolution (see `revolve`) with its texture in metres."""
    mesh = revolve(profile, segments)
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
    """A piece of furniture in the making: parts by material, and its supports, all in one frame."""

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
        self, stuff: Material, mesh: Mesh, offset: ArrayLike = (0.0, 0.0, 0.0), turn: float = 0.0,
        tilt: float = 0.0,
    ) -> None:  # fmt: skip
        """A mesh, tilted about x, turned about z and shifted."""
        self._materials[id(stuff)] = stuff
        self._meshes.setdefault(id(stuff), []).append(moved(mesh, offset, turn, tilt))

    def support(
        self, zone: str, low: tuple[float, float], high: tuple[float, float], z: float,
        clearance: float = float("inf"), behind: float = float("inf"),
    ) -> None:  # fmt: skip
        """A level rectangle between two corners at height z; one too small for any object is left out."""
        half = ((high[0] - low[0]) / 2, (high[1] - low[1]) / 2)
        if min(half) < 0.06:
            return
        centre = ((low[0] + high[0]) / 2, (low[1] + high[1]) / 2, z)
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
