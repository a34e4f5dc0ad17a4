"""Texture coordinates of a class's faces: its mean shape cut into charts, seen along the axes.

Made once for a class. A chart is a connected piece whose faces look along the same of the six directions of
the axes; it is seen from there, so that lengths are shortened by 1.7 at most.
"""

import functools
from dataclasses import dataclass

import numpy as np

from vig.renderer.drawing import draw_mesh, mesh_of
from vig.scene import ObjectClass

SIDE = 512  # texels a side
GAP = 4  # texels between charts, at least
WIDENED = 2 * GAP  # texels round a chart that show it, too, for a viewer that reduces the image
AXES = np.repeat(np.eye(3), 2, 0) * np.array([[1], [-1]] * 3)
"""(6, 3), the directions that charts look along, outwards."""
MIN_COSINE = 0.25
"""Cosine of a face's normal and its chart's direction, at least: else it takes the one nearest its normal."""
SPLITS = 4  # times that faces below another part of their chart are made a chart of their own


@dataclass(frozen=True, eq=False)
class Atlas:
    """The texture coordinates of a mesh of V vertices and F faces, and the surface points of its texels.

    Attributes:
        source: (U,) the vertex of each of the atlas's own vertices, which are doubled along charts' borders.
        faces: (F, 3) of these, in the mesh's order.
        coordinates: (U, 2) float32 in [0, 1], right and down from the image's corner, as glTF has them.
        texels: (SIDE^2,) int, of each pixel of the image, row by row, the texel that it shows: its own,
            next to a chart one of the nearest, far from all the first.
        face: (T,) of each texel.
        weights: (T, 3) float32 of the corners of its face at the texel's middle.
    """

    source: np.ndarray
    faces: np.ndarray
    coordinates: np.ndarray
    texels: np.ndarray
    face: np.ndarray
    weights: np.ndarray

    def at_texels(self, values: np.ndarray) -> np.ndarray:
        """Return values (T, C) at the texels' middles from those of the vertices (V, C)."""
        first, second, third = self.source[self.faces[self.face]].T
        at: np.ndarray = self.weights[:, :1] * values[first]
        at += self.weights[:, 1:2] * values[second]
        at += self.weights[:, 2:] * values[third]
        return at


@functools.lru_cache(maxsize=8)
def atlas_of(object_class: ObjectClass) -> Atlas | None:
    """Return the atlas of a class's shapes; None where its mesh is in more pieces than the image holds."""
    model = object_class.shape_model
    vertices, faces = model.mean.astype(np.float64), model.faces
    direction = _directions(vertices, faces)
    for _ in range(SPLITS):
        chart = _charts(faces, direction)
        flat, height = _flat(vertices, faces, direction)
        packed = _pack_charts(flat, chart)
        if packed is None:
            return None
        place, scale = packed
        seen = _highest_faces(place, height)
        below = _below(place, scale * height, seen)
        if not below.any():
            break
        direction = np.where(below, direction + len(AXES), direction)
    return _join_charts(place, faces, chart, seen, len(vertices)) if (seen >= 0).any() else None


def _join_charts(
    place: np.ndarray, faces: np.ndarray, chart: np.ndarray, seen: np.ndarray, count: int
) -> Atlas:
    """Return the atlas of faces of `count` vertices, corners at texels `place`; `seen` (SIDE, SIDE) shows
    them.
    """
    keys, first, corners = np.unique(
        chart[:, None] * np.int64(count) + faces, return_index=True, return_inverse=True
    )
    rows, columns = np.nonzero(seen >= 0)
    face = seen[rows, columns]
    a, b, c = place[face].transpose(1, 2, 0)
    (along, down), (along_other, down_other) = b - a, c - a
    x, y = np.stack([columns, rows]) + 0.5 - a
    area = along * down_other - down * along_other
    second, third = (x * down_other - y * along_other) / area, (y * along - x * down) / area
    shares = np.stack([1 - second - third, second, third], axis=1).astype(np.float32)
    number = np.full(seen.shape, -1, np.int32)
    number[rows, columns] = np.arange(len(face))
    return Atlas(
        source=(keys % count).astype(np.int32),
        faces=corners.reshape(-1, 3).astype(np.int32),
        coordinates=(place.reshape(-1, 2)[first] / SIDE).astype(np.float32),
        texels=_spread_texels(number).ravel(),
        face=face,
        weights=shares,
    )


def _spread_texels(number: np.ndarray) -> np.ndarray:
    """Return numbers (SIDE, SIDE), -1 for none, spread by up to `WIDENED` texels; 0 elsewhere."""
    number = number.copy()
    for _ in range(WIDENED):
        before = number.copy()
        for to, off in ((np.s_[1:], np.s_[:-1]), (np.s_[:-1], np.s_[1:])):
            for target, source in ((number[to], before[off]), (number[:, to], before[:, off])):
                np.copyto(target, source, where=target < 0)
    return np.maximum(number, 0)


def _directions(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Return (F,) the row of `AXES` that each face is seen along."""
    a, b, c = vertices[faces].transpose(1, 0, 2)
    normals = np.cross(b - a, c - a)
    own = normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)
    pairs = _neighbours(faces)
    smooth = own
    for _ in range(3):  # so that charts have few, smooth borders
        before, smooth = smooth, smooth.copy()
        np.add.at(smooth, pairs[:, 0], before[pairs[:, 1]])
        np.add.at(smooth, pairs[:, 1], before[pairs[:, 0]])
        smooth /= np.maximum(np.linalg.norm(smooth, axis=1, keepdims=True), 1e-30)
    direction = (smooth @ AXES.T).argmax(1)
    steep = (own * AXES[direction]).sum(1) < MIN_COSINE
    return np.where(steep, (own @ AXES.T).argmax(1), direction)


def _neighbours(faces: np.ndarray) -> np.ndarray:
    """Return (N, 2) pairs of faces that share an edge."""
    edges = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    order = np.lexsort(edges.T)
    same = (edges[order[1:]] == edges[order[:-1]]).all(1)
    return np.stack([order[1:][same], order[:-1][same]], axis=1) // 3


def _charts(faces: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Return (F,) the number of each face's chart."""
    pairs = _neighbours(faces)
    one, other = pairs[direction[pairs[:, 0]] == direction[pairs[:, 1]]].T
    first = np.arange(len(faces))  # first face that each face is known to be connected to
    while (apart := first[one] != first[other]).any():
        low, high = np.sort([first[one[apart]], first[other[apart]]], axis=0)
        np.minimum.at(first, high, low)
        while (further := first[first] != first).any():
            first[further] = first[first[further]]
    return np.unique(first, return_inverse=True)[1]


def _flat(vertices: np.ndarray, faces: np.ndarray, direction: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return places of each face's corners in its chart (F, 3, 2), clockwise, and height above it (F, 3)."""
    axis = direction % len(AXES)
    side = np.where(axis % 2, -1.0, 1.0)[:, None]
    right, up = np.array([[1, 2], [2, 0], [0, 1]])[axis // 2].T
    corners = vertices[faces]
    rows = np.arange(len(faces))[:, None], np.arange(3)
    across, along = corners[*rows, right[:, None]], corners[*rows, up[:, None]]
    return np.stack([across, -side * along], axis=2), side * corners[*rows, axis[:, None] // 2]


def _pack_charts(flat: np.ndarray, chart: np.ndarray) -> tuple[np.ndarray, float] | None:
    """Return texels (F, 3, 2) of the corners, and texels per metre; None where even points do not go in.

    Charts lie in rows of falling height, as large as they go in together.
    """
    _, size = _boxes(flat, chart)
    upright = size[:, 1] > size[:, 0]  # turned by a quarter, so that it is wider than high
    turned = np.stack([-flat[..., 1], flat[..., 0]], axis=2)
    flat = np.where(upright[chart][:, None, None], turned, flat)
    low, size = _boxes(flat, chart)
    fits, scale = 0.0, SIDE / max(float(np.sqrt(size.prod(1).sum())), 1e-9)
    step = scale
    for _ in range(16):
        step /= 2
        if _corners(scale * size) is None:
            scale -= step
        else:
            fits, scale = scale, scale + step
    corner = _corners(fits * size)
    return None if corner is None else (corner[chart][:, None] + fits * (flat - low[chart][:, None]), fits)


def _boxes(flat: np.ndarray, chart: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the least coordinates (N, 2) and extent (N, 2) of each chart."""
    low, high = np.full((2, chart.max() + 1, 2), [[[np.inf]], [[-np.inf]]])
    np.minimum.at(low, np.repeat(chart, 3), flat.reshape(-1, 2))
    np.maximum.at(high, np.repeat(chart, 3), flat.reshape(-1, 2))
    return low, high - low


def _corners(size: np.ndarray) -> np.ndarray | None:
    """Return upper left texels of rectangles (N, 2) in rows, None where they do not go into the image."""
    corner = np.empty_like(size)
    x = y = high = float(GAP)
    for number in np.argsort(-size[:, 1], kind="stable").tolist():
        width, height = size[number].tolist()
        if x + width + GAP > SIDE:
            x, y, high = float(GAP), y + high + GAP, height
        if x == GAP:
            high = height
        if x + width + GAP > SIDE or y + height + GAP > SIDE:
            return None
        corner[number] = x, y
        x += width + GAP
    return corner


def _highest_faces(place: np.ndarray, height: np.ndarray) -> np.ndarray:
    """Return (SIDE, SIDE) the face that is the highest at each texel, -1 for none."""
    # 0.02: depth of the charts before the camera that draws them, over its distance
    depth = 1 - 0.02 * (height - height.min()) / max(float(np.ptp(height)), 1e-9)
    points = np.concatenate([place, np.ones_like(height)[..., None]], axis=2) * depth[..., None]
    points = points.reshape(-1, 3).astype(np.float32)
    mesh = mesh_of(np.arange(len(points)).reshape(-1, 3))
    camera = np.eye(3), np.zeros(3), np.ones(2), np.zeros(2)
    return draw_mesh(mesh, points, None, np.ones(3), camera, SIDE, SIDE).triangle_id


def _below(place: np.ndarray, height: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """Return (F,) whether another face lies over a face's middle, and not only beside it; all in texels."""
    column, row = place.mean(1).astype(int).T
    over = seen[row, column]
    reach = np.ptp(place[over], axis=1).max(1) + np.ptp(place, axis=1).max(1) + 2
    far = height.mean(1)[over] - height.mean(1) > reach / MIN_COSINE
    return (over >= 0) & far
