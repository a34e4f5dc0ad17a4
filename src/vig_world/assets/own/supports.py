"""Finds supports on furniture: level areas with free space above, from its triangles."""

from dataclasses import dataclass

import numpy as np

from vig_world.assets.things import Support
from vig_world.mesh import face_normals

MIN_SIDE = 0.15
MIN_CLEARANCE = 0.2  # least side and free height of a support, metres
_CELL = 0.02
_LEVEL = 0.01  # metres by which heights on one support may differ from its own
_REACH = 0.3


@dataclass(frozen=True)
class _Hits:
    """Hits of vertical lines through cells on faces: cell row and column, height, whether it looks up."""

    row: np.ndarray
    column: np.ndarray
    z: np.ndarray
    up: np.ndarray
    clearance: np.ndarray
    shape: tuple[int, int]
    origin: np.ndarray


def level_areas(vertices: np.ndarray, faces: np.ndarray) -> list[Support]:
    """Return level rectangles along the axes, at least MIN_SIDE long with MIN_CLEARANCE above, largest
    first, of no zone.

    vertices (V, 3) metres, Z up; faces (F, 3), counter-clockwise seen from outside. At most 12.
    """
    hits = _hits(vertices, faces)
    usable = hits.up & (hits.clearance >= MIN_CLEARANCE)
    areas: list[tuple[int, Support]] = []
    most_supports = 12
    while usable.any() and len(areas) < 4 * most_supports:
        bins = np.round(hits.z[usable] / (_LEVEL / 2)).astype(int)
        counts = np.bincount(bins - bins.min())
        width = np.convolve(counts, np.ones(3, int), mode="same")
        level = (int(width.argmax()) + bins.min()) * _LEVEL / 2
        near = usable & (np.abs(hits.z - level) <= _LEVEL)
        grid = np.zeros(hits.shape, bool)
        grid[hits.row[near], hits.column[near]] = True
        top, bottom, left, right = largest_rectangle(grid)
        if min(bottom - top, right - left) * _CELL < MIN_SIDE:
            usable &= ~near
            continue
        inside = (
            near & (hits.row >= top) & (hits.row < bottom) & (hits.column >= left) & (hits.column < right)
        )
        usable &= ~inside
        low = hits.origin + _CELL * np.array([left, top])
        high = hits.origin + _CELL * np.array([right, bottom])
        z = float(np.median(hits.z[inside]))
        clearance = float((hits.clearance[inside] - (z - hits.z[inside])).min())
        area = _open_support(vertices, faces, low, high, z, clearance)
        if area is not None:
            areas.append(((bottom - top) * (right - left), area))
    areas.sort(key=lambda item: -item[0])
    return [area for _, area in areas[:most_supports]]


def _hits(vertices: np.ndarray, faces: np.ndarray) -> _Hits:
    """Cast a vertical line through the centre of each cell of a grid over the furniture."""
    low, high = vertices.min(0)[:2], vertices.max(0)[:2]
    shape = (int((high - low)[1] / _CELL) + 1, int((high - low)[0] / _CELL) + 1)
    normals = face_normals(vertices, faces)
    flat = np.abs(normals[:, 2]) > 1e-12
    faces, normals = faces[flat], normals[flat]
    corners = vertices[faces]
    flat_corners = (corners[..., :2] - low) / _CELL - 0.5
    first = np.ceil(flat_corners.min(1)).astype(int)
    last = np.floor(flat_corners.max(1)).astype(int)
    span = np.maximum(last - first + 1, 0)
    total = span[:, 0] * span[:, 1]
    face = np.repeat(np.arange(len(faces)), total)
    within = np.arange(len(face)) - np.repeat(np.cumsum(total) - total, total)
    column = first[face, 0] + within % np.maximum(span[face, 0], 1)
    row = first[face, 1] + within // np.maximum(span[face, 0], 1)
    a, b, c = (flat_corners[face, i] for i in range(3))
    point = np.stack([column, row], axis=1)
    double = _cross(b - a, c - a)
    weights = np.stack([_cross(b - point, c - point), _cross(c - point, a - point)], 1) / double[:, None]
    weights = np.concatenate([weights, 1 - weights.sum(1, keepdims=True)], axis=1)
    met = (weights >= -1e-9).all(1) & (row >= 0) & (column >= 0) & (row < shape[0]) & (column < shape[1])
    row, column, face = row[met], column[met], face[met]
    z = np.einsum("nk,nk->n", weights[met], corners[face][..., 2])
    order = np.lexsort((z, row * shape[1] + column))
    row, column, z, face = row[order], column[order], z[order], face[order]
    up = normals[face, 2] > 0.95 * np.linalg.norm(normals[face], axis=1)
    cell = row * shape[1] + column
    clearance = np.full(len(z), np.inf)
    above = np.full(len(z), np.inf)  # height of the next face that lies more than a hair higher
    for i in range(len(z) - 2, -1, -1):
        if cell[i] == cell[i + 1]:
            above[i] = z[i + 1] if z[i + 1] > z[i] + 1e-3 else above[i + 1]
    clearance = above - z
    return _Hits(row, column, z, up, clearance, shape, low)


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]


def largest_rectangle(grid: np.ndarray) -> tuple[int, int, int, int]:
    """Return the largest rectangle of true cells (H, W): first and end row, first and end column; 0 if none.

    Per row, columns of true cells are the bars of a histogram, and a stack of rising bars gives the largest
    rectangle under it.
    """
    best, rectangle = 0, (0, 0, 0, 0)
    heights = np.zeros(grid.shape[1] + 1, int)
    for row in range(len(grid)):
        heights[:-1] = np.where(grid[row], heights[:-1] + 1, 0)
        stack: list[tuple[int, int]] = []
        for column, height in enumerate(heights.tolist()):
            start = column
            while stack and stack[-1][1] >= height:
                start, tall = stack.pop()
                if tall * (column - start) > best:
                    best, rectangle = tall * (column - start), (row + 1 - tall, row + 1, start, column)
            stack.append((start, height))
    return rectangle


def _open_support(
    vertices: np.ndarray, faces: np.ndarray, low: np.ndarray, high: np.ndarray, z: float, clearance: float
) -> Support | None:
    """Return the rectangle from low to high (2,) with the first open side for its front: -y, +x, +y, -x.

    None when no side is open, as inside a cupboard with its doors shut.
    """
    middle, half = (low + high) / 2, (high - low) / 2
    for quarter in range(4):
        c, s = [(1, 0), (0, 1), (-1, 0), (0, -1)][quarter]
        to_rectangle = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]], np.float64)  # to the rectangle's own axes
        turned = vertices @ to_rectangle.T
        centre = np.append(middle, z) @ to_rectangle.T
        extents = half if quarter % 2 == 0 else half[::-1]
        if _front_is_open(turned[faces], centre, extents, clearance):
            behind = _behind(turned, faces, centre[:2] - extents, centre[:2] + extents, z)
            place = (float(middle[0]), float(middle[1]), z)
            half_sides = (float(extents[0]), float(extents[1]))
            return Support("", place, half_sides, quarter * np.pi / 2, clearance, behind)
    return None


def _front_is_open(corners: np.ndarray, centre: np.ndarray, half: np.ndarray, clearance: float) -> bool:
    """Return whether most horizontal lines from above a rectangle towards -y meet no faces (F, 3, 3)."""
    height = centre[2] + 0.5 * min(clearance, _REACH)
    free = 0
    for share in (-0.7, -0.35, 0.0, 0.35, 0.7):
        # In the plane of x and z: the line is a point, a face a triangle; it is met where y lies ahead.
        relative = corners - np.array([centre[0] + share * half[0], 0, height])
        flat = relative[..., [0, 2]]
        edges = [_cross(flat[:, i], flat[:, (i + 1) % 3]) for i in range(3)]
        double = edges[0] + edges[1] + edges[2]
        met = (np.abs(double) > 1e-12) & np.all([edge * double >= 0 for edge in edges], axis=0)
        weights = np.stack([edges[1], edges[2], edges[0]], axis=1)[met] / double[met, None]
        free += not ((weights * relative[met][..., 1]).sum(1) < centre[1]).any()
    return free >= 3


def _behind(vertices: np.ndarray, faces: np.ndarray, low: np.ndarray, high: np.ndarray, z: float) -> float:
    """Return metres from a rectangle's +y edge to the first face above it that looks to -y; inf if none."""
    normals = face_normals(vertices, faces)
    corners = vertices[faces]
    facing = normals[:, 1] < -0.7 * np.linalg.norm(normals, axis=1)
    least, most = corners.min(1), corners.max(1)
    in_way = facing & (least[:, 2] < z + _REACH) & (most[:, 2] > z + _LEVEL)
    in_way &= (least[:, 0] < high[0]) & (most[:, 0] > low[0]) & (most[:, 1] > high[1] - _CELL)
    if not in_way.any():
        return float("inf")
    return max(float(least[in_way, 1].min() - high[1]), 0.0)
