"""Closed building blocks for things without a model: bevelled boxes, tubes, reliefs.

Every mesh is closed (its faces' area vectors add up to zero), its faces look outward, and it has texture
coordinates: u to the right and v up as seen from outside, (0, 0) at the texture's bottom left. Edges that
should look sharp have vertices of their own on each side, so that averaged vertex normals shade well.
"""

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vig_world.mesh import Mesh, face_normals

Array = np.ndarray
Points = Array | Sequence[Any]  # coordinates by rows: an array, or rows of numbers


def _mesh(vertices: ArrayLike, faces: ArrayLike, uv: ArrayLike) -> Mesh:
    """Return a Mesh with the empty triangles dropped and the faces turned outward (positive volume)."""
    points = np.asarray(vertices, np.float32)
    triangles = np.asarray(faces, np.int32).reshape(-1, 3)
    normals = face_normals(points.astype(np.float64), triangles)
    outwards = (points[triangles[:, 0]] * normals).sum()
    triangles = triangles[(normals**2).sum(1) > 1e-20]
    if outwards < 0:
        triangles = triangles[:, ::-1]
    return Mesh(points, np.ascontiguousarray(triangles), np.asarray(uv, np.float32))


@lru_cache(maxsize=256)
def _grid_faces(rows: int, columns: int, wrap: bool) -> NDArray[np.int32]:
    """Return two triangles per cell of a row-major vertex grid; `wrap` joins the last column to the first."""
    r, c = np.meshgrid(np.arange(rows - 1), np.arange(columns if wrap else columns - 1), indexing="ij")
    a, b = r * columns + c, r * columns + (c + 1) % columns
    quads = np.stack([a, b, b + columns, a, b + columns, a + columns], -1)
    return quads.reshape(-1, 3).astype(np.int32)


def smooth(points: Points, count: int) -> Array:
    """Return a round curve (count, D) through control points (N, D): a Catmull-Rom spline."""
    p = np.asarray(points, np.float64)
    p = np.concatenate([2 * p[:1] - p[1:2], p, 2 * p[-1:] - p[-2:-1]])
    t = np.linspace(0, len(p) - 3, count)
    i = np.minimum(t.astype(int), len(p) - 4)
    t = (t - i)[:, None]
    a, b, c, d = p[i], p[i + 1], p[i + 2], p[i + 3]
    return 0.5 * (2 * b + (c - a) * t + (2 * a - 5 * b + 4 * c - d) * t**2 + (3 * b - a - 3 * c + d) * t**3)


def scale_mesh(mesh: Mesh, factor: ArrayLike) -> Mesh:
    """Return the mesh times a positive factor, one for all axes or (3,) for each."""
    return Mesh((mesh.vertices * np.asarray(factor)).astype(np.float32), mesh.faces, mesh.uv)


_FRAMES = np.array(  # normal, right, up of the six sides, each seen from outside
    [
        [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
        [[-1, 0, 0], [0, -1, 0], [0, 0, 1]],
        [[0, 1, 0], [-1, 0, 0], [0, 0, 1]],
        [[0, -1, 0], [1, 0, 0], [0, 0, 1]],
        [[0, 0, 1], [1, 0, 0], [0, 1, 0]],
        [[0, 0, -1], [1, 0, 0], [0, -1, 0]],
    ],
    np.float64,
)


@lru_cache(maxsize=1)
def _bevelled_cube() -> tuple[Array, Array, Array, NDArray[np.int_]]:
    """Return signs (N, 3), cut axes (N, 3) in 0/1 and side (N,) of a bevelled box's vertices, and triangles.

    A vertex lies at signs * (half size - bevel * cut). First come the six sides, four vertices each, then the
    edges' strips, then the corners' triangles.
    """
    signs: list[Array] = []
    cuts: list[Array] = []
    sides: list[int] = []
    triangles: list[list[int]] = []

    def add(side: int, corners: Sequence[tuple[int, Sequence[float]]]) -> None:
        """Add a convex polygon textured as a part of a side: per corner, the axis not cut and the signs."""
        polygon = [(np.asarray(sign, np.float64), 1.0 - np.eye(3)[axis]) for axis, sign in corners]
        p = [sign * (1 - 0.2 * cut) for sign, cut in polygon]
        if np.cross(p[1] - p[0], p[2] - p[0]) @ np.mean(p, axis=0) < 0:
            polygon = polygon[::-1]
        start = len(signs)
        signs.extend(sign for sign, _ in polygon)
        cuts.extend(cut for _, cut in polygon)
        sides.extend([side] * len(polygon))
        triangles.extend([start, start + k, start + k + 1] for k in range(1, len(polygon) - 1))

    around = [(-1, -1), (1, -1), (1, 1), (-1, 1)]
    for side, frame in enumerate(_FRAMES):
        add(side, [(side // 2, frame.T @ [1, *s]) for s in around])
    for first, second, along in ((0, 1, 2), (0, 2, 1), (1, 2, 0)):
        for s in around:
            ends = np.zeros((2, 3))
            ends[:, first], ends[:, second], ends[:, along] = s[0], s[1], (-1, 1)
            strip = [(first, ends[0]), (first, ends[1]), (second, ends[1]), (second, ends[0])]
            add(2 * first + (s[0] < 0), strip)
    for s in around:
        for top in (-1, 1):
            add(4 + (top < 0), [(axis, (*s, top)) for axis in range(3)])
    return np.array(signs), np.array(cuts), np.array(sides), np.array(triangles)


def box(size: Points, bevel: float = 0.0) -> Mesh:
    """Return a box (x, y, z) on z = 0, centred, its edges cut off by `bevel`; each side shows the texture."""
    half = np.asarray(size, np.float64) / 2
    bevel = min(bevel, 0.9 * half.min())
    signs, cuts, sides, triangles = _bevelled_cube()
    if bevel == 0:
        signs, cuts, sides, triangles = signs[:24], cuts[:24], sides[:24], triangles[:12]
    points = signs * (half - bevel * cuts)
    frames = _FRAMES[sides, 1:]  # each vertex's right and up
    uv = np.einsum("nij,nj->ni", frames, points) / (2 * np.abs(frames) @ half) + 0.5
    return _mesh(points + [0, 0, half[2]], triangles, uv)


def tube(path: Points, radius: ArrayLike, sides: int = 8, up: ArrayLike = (0.0, 0.0, 1.0)) -> Mesh:
    """Return a closed tube along a path.

    Args:
        path: (N, 3) centre line.
        radius: a number, (N,), or (N, 2) half widths: across `up` and the path, and towards `up` (unequal
            ones make blades and leaves).
        sides: vertices round the path.
        up: a direction never along the path; fixes the section's orientation.
    """
    p = np.asarray(path, np.float64)
    widths = np.asarray(radius, np.float64)
    widths = np.broadcast_to(widths[:, None] if widths.ndim == 1 else widths, (len(p), 2))
    tangent = np.gradient(p, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    across = np.cross(tangent, np.asarray(up, np.float64))
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    over = np.cross(across, tangent)
    turn = np.arange(sides) / sides
    angle = 2 * np.pi * turn
    ring = widths[:, :1, None] * np.cos(angle)[:, None] * across[:, None]
    ring = p[:, None] + ring + widths[:, 1:, None] * np.sin(angle)[:, None] * over[:, None]
    v = np.linspace(0, 1, len(p))
    uv = np.stack(np.broadcast_arrays(1 - np.abs(2 * turn - 1), v[:, None]), -1)
    faces = _grid_faces(len(p), sides, wrap=True)
    caps = []
    rims = np.concatenate([ring[0], ring[-1]])  # the ends' own vertices: sharp edges
    for end, first in ((0, ring.shape[0] * sides), (1, (ring.shape[0] + 1) * sides)):
        k = np.arange(1, sides - 1)
        fan = np.stack([np.zeros_like(k), k, k + 1], -1)
        caps.append(first + (fan[:, ::-1] if end == 0 else fan))
    section = 0.5 + 0.5 * np.stack([np.cos(angle), np.sin(angle)], -1)
    return _mesh(
        np.concatenate([ring.reshape(-1, 3), rims]),
        np.concatenate([faces, *caps]),
        np.concatenate([uv.reshape(-1, 2), section, section]),
    )


def relief(x: ArrayLike, y: ArrayLike, top: ArrayLike, bottom: ArrayLike | float = 0.0) -> Mesh:
    """Return a closed sheet between two surfaces over a grid: x, y, top, bottom (R, C); vertical edges."""
    x, y, top = (np.asarray(a, np.float64) for a in (x, y, top))
    rows, columns = top.shape
    low = np.broadcast_to(np.asarray(bottom, np.float64), top.shape)
    u, v = np.broadcast_arrays(np.linspace(0, 1, columns), np.linspace(0, 1, rows)[:, None])
    sheet = _grid_faces(rows, columns, wrap=False)
    index = np.arange(top.size).reshape(top.shape)
    edge = np.concatenate([index[0, :-1], index[:-1, -1], index[-1, :0:-1], index[:0:-1, 0]])
    k = len(edge)
    i = np.arange(k)
    j = (i + 1) % k
    first = 2 * top.size
    skirt = first + np.concatenate([np.stack([j, i, i + k], -1), np.stack([j, i + k, j + k], -1)])
    over = np.stack([x, y, top], -1).reshape(-1, 3)
    under = np.stack([x, y, low], -1).reshape(-1, 3)
    uv = np.stack([u, v], -1).reshape(-1, 2)
    return _mesh(
        np.concatenate([over, under, over[edge], under[edge]]),
        np.concatenate([sheet, top.size + sheet[:, ::-1], skirt]),
        np.concatenate([uv, uv, uv[edge], uv[edge]]),
    )


def move_mesh(mesh: Mesh, offset: ArrayLike = (0.0, 0.0, 0.0), turn: float = 0.0, tilt: float = 0.0) -> Mesh:
    """Return the mesh tilted by `tilt` about x, then turned by `turn` about z (radians), then shifted."""
    ct, st, cz, sz = np.cos(tilt), np.sin(tilt), np.cos(turn), np.sin(turn)
    rotation = np.array([[cz, -sz, 0], [sz, cz, 0], [0, 0, 1]]) @ np.array(
        [[1, 0, 0], [0, ct, -st], [0, st, ct]]
    )
    points = mesh.vertices.astype(np.float64) @ rotation.T + np.asarray(offset, np.float64)
    return Mesh(points.astype(np.float32), mesh.faces, mesh.uv)
