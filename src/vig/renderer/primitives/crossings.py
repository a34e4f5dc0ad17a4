"""Where visible occlusion edges pass between the centres of neighbouring pixels.

An edge of a mesh is a *silhouette edge* where its two faces lie on the same side of it on the screen, or
where there is one face only. Where it crosses the line between two neighbouring pixel centres, the faces
around are searched for one that hides the crossing; those that none hides are kept. This is exact for the
polygons: no tolerance in metres, no normals, no winding. Surfaces that pierce each other have none where they
do.
"""

import functools
from dataclasses import dataclass
from types import SimpleNamespace

import torch
import warp as wp

from vig.io.checks import check_indices
from vig.renderer.device import (
    check_floats,
    check_size,
    check_table,
    initialise,
    kernel_module,
    launch,
    opaque,
    scalar_type,
)
from vig.renderer.primitives.visibility import beyond_near
from vig.renderer.raster import NEAR


@functools.cache
def _kernels(dtype: torch.dtype) -> SimpleNamespace:
    """Kernels and their functions on homogeneous screen points."""
    initialise()
    real = scalar_type(dtype)
    vec2, vec3 = wp.types.vector(2, real), wp.types.vector(3, real)
    module = kernel_module("crossings", dtype)
    near, half = real(NEAR), real(0.5)
    nearer = real(1.0 - (1e-5 if dtype == torch.float32 else 1e-9))

    @wp.func
    def from_pixel(point: vec3, x: real, y: real):
        """The point's place relative to a pixel, still times its depth."""
        return vec2(point[0] - x * point[2], point[1] - y * point[2])

    @wp.func
    def cross(a: vec2, b: vec2):
        return a[0] * b[1] - a[1] * b[0]

    @wp.func
    def weights_at(a: vec3, b: vec3, c: vec3, x: real, y: real):
        """Barycentric weights, up to one common factor, of the ray through (x, y)."""
        oa = from_pixel(a, x, y)
        ob = from_pixel(b, x, y)
        oc = from_pixel(c, x, y)
        return vec3(cross(ob, oc), -cross(oa, oc), cross(oa, ob))

    @wp.func
    def depth_inside(weights: vec3, a: vec3, b: vec3, c: vec3):
        """Depth where the ray of these weights meets the triangle; -1 where it passes beside it."""
        inside = (weights[0] >= real(0.0) and weights[1] >= real(0.0) and weights[2] >= real(0.0)) or (
            weights[0] <= real(0.0) and weights[1] <= real(0.0) and weights[2] <= real(0.0)
        )
        total = weights[0] + weights[1] + weights[2]
        if not inside or total == real(0.0):
            return real(-1.0)
        return (weights[0] * a[2] + weights[1] * b[2] + weights[2] * c[2]) / total

    @wp.func
    def box_of(a: vec3, b: vec3, c: vec3):
        """Bounding box in pixels of a triangle beyond the near plane."""
        pa = vec2(a[0], a[1]) / a[2]
        pb = vec2(b[0], b[1]) / b[2]
        pc = vec2(c[0], c[1]) / c[2]
        return wp.min(pa, wp.min(pb, pc)), wp.max(pa, wp.max(pb, pc))

    @wp.func
    def first_line(low: real):
        """The first row or column from `low` on, clamped before the conversion to an integer."""
        return int(wp.ceil(wp.max(low, real(0.0))))

    @wp.func
    def last_line(high: real, count: int):
        """The last row or column up to `high`, clamped before the conversion to an integer."""
        return int(wp.floor(wp.min(high, real(count - 1))))

    @wp.func
    def side(a: vec3, b: vec3, c: vec3):
        """On which side of the line from a to b, on the screen, the face with third vertex c lies."""
        x = a[0] / a[2]
        y = a[1] / a[2]
        return cross(from_pixel(b, x, y), from_pixel(c, x, y))

    @wp.kernel(module=module)
    def find_silhouette(
        points: wp.array(dtype=vec3),
        edges: wp.array2d(dtype=wp.int32),
        chosen: wp.array(dtype=wp.uint8),
    ):
        edge = wp.tid()
        chosen[edge] = wp.uint8(0)
        a = points[edges[edge, 0]]
        b = points[edges[edge, 1]]
        if a[2] < near or b[2] < near:
            return
        if edges[edge, 3] < 0:
            chosen[edge] = wp.uint8(1)
            return
        here = side(a, b, points[edges[edge, 2]])
        there = side(a, b, points[edges[edge, 3]])
        if (here > real(0.0) and there > real(0.0)) or (here < real(0.0) and there < real(0.0)):
            chosen[edge] = wp.uint8(1)

    @wp.kernel(module=module)
    def cross_lines(
        points: wp.array(dtype=vec3),
        edges: wp.array2d(dtype=wp.int32),
        layer: wp.array(dtype=wp.int32),
        chosen: wp.array(dtype=wp.int64),
        fill: wp.int32,
        counts: wp.array(dtype=wp.int32),
        ends: wp.array(dtype=wp.int32),
        heads: wp.array4d(dtype=wp.int32),
        links: wp.array(dtype=wp.int32),
        cells: wp.array2d(dtype=wp.int32),
        spots: wp.array(dtype=vec3),
    ):
        """First time: count each edge's crossings. Second time: write them, and link those of one cell."""
        index = wp.tid()
        edge = int(chosen[index])
        a = points[edges[edge, 0]]
        b = points[edges[edge, 1]]
        image = layer[edges[edge, 4]]
        pa = vec2(a[0], a[1]) / a[2]
        pb = vec2(b[0], b[1]) / b[2]
        found = wp.int32(0)
        for axis in range(2):
            # u runs along the pair of pixels, v across: (x, y) for pairs in a row, (y, x) in a column.
            across = 1 - axis
            steps = heads.shape[3 - axis]
            lines = heads.shape[2 + axis]
            va = pa[across]
            vb = pb[across]
            if wp.max(va, vb) < half or wp.min(va, vb) > real(lines):
                continue
            for line in range(first_line(wp.min(va, vb) - half), last_line(wp.max(va, vb) - half, lines) + 1):
                v = real(line) + half
                # Half open, so that two edges that meet on a line cross it once.
                if (va <= v) == (vb <= v):
                    continue
                share = (v - va) / (vb - va)
                u = pa[axis] + share * (pb[axis] - pa[axis])
                if u < half or u >= real(steps) - half:
                    continue
                low = wp.min(int(wp.floor(u - half)), steps - 2)
                if fill == 1:
                    at = ends[index] - counts[index] + found
                    x = low
                    y = line
                    spot = vec2(u, v)
                    if axis == 1:
                        x = line
                        y = low
                        spot = vec2(v, u)
                    cells[at, 0] = index
                    cells[at, 1] = axis
                    cells[at, 2] = image
                    cells[at, 3] = y
                    cells[at, 4] = x
                    depth = real(1.0) / ((real(1.0) - share) / a[2] + share / b[2])
                    spots[at] = vec3(spot[0], spot[1], depth)
                    links[at] = wp.atomic_exch(heads, image, axis, y, x, at)
                found = found + 1
        if fill == 0:
            counts[index] = found

    @wp.kernel(module=module)
    def hide(
        points: wp.array(dtype=vec3),
        parts: wp.array2d(dtype=wp.int32),
        origin: wp.array(dtype=wp.int64),
        faces: wp.array2d(dtype=wp.int32),
        layer: wp.array(dtype=wp.int32),
        edges: wp.array2d(dtype=wp.int32),
        chosen: wp.array(dtype=wp.int64),
        heads: wp.array4d(dtype=wp.int32),
        links: wp.array(dtype=wp.int32),
        cells: wp.array2d(dtype=wp.int32),
        spots: wp.array(dtype=vec3),
        hidden: wp.array(dtype=wp.uint8),
    ):
        """Mark the crossings that a face hides, looked for in the box of its part beyond the near plane.

        A cell holds the crossings after its pixel's centre.
        """
        part = wp.tid()
        face = int(origin[part])
        a = points[faces[face, 0]]
        b = points[faces[face, 1]]
        c = points[faces[face, 2]]
        image = layer[face]
        low, high = box_of(points[parts[part, 0]], points[parts[part, 1]], points[parts[part, 2]])
        if not (low[0] <= high[0] and low[1] <= high[1]):
            return
        for axis in range(2):
            before = vec2(half, half)
            before[axis] = half + real(1.0)
            x0 = first_line(low[0] - before[0])
            y0 = first_line(low[1] - before[1])
            x1 = last_line(high[0] - half, heads.shape[3])
            y1 = last_line(high[1] - half, heads.shape[2])
            for y in range(y0, y1 + 1):
                for x in range(x0, x1 + 1):
                    at = heads[image, axis, y, x]
                    while at >= 0:
                        edge = int(chosen[cells[at, 0]])
                        if hidden[at] == wp.uint8(0) and edges[edge, 4] != face and edges[edge, 5] != face:
                            spot = spots[at]
                            weights = weights_at(a, b, c, spot[0], spot[1])
                            depth = depth_inside(weights, a, b, c)
                            if depth >= near and depth < spot[2] * nearer:
                                hidden[at] = wp.uint8(1)
                        at = links[at]

    return SimpleNamespace(find_silhouette=find_silhouette, cross_lines=cross_lines, hide=hide)


@dataclass(frozen=True)
class Crossings:
    """Silhouette edges of B images of H x W, and where M of them visibly cross the lines of pixel centres.

    Attributes:
        edges: (S, 2) int64, the vertices a and b of each silhouette edge, visible or not.
        edge: (M,) int64, which of these crosses.
        axis: (M,) int64, 0 between neighbours in a row, 1 in a column.
        line: (M,) which row (axis 0) or column.
        low: (M,) the neighbour's column (row) that comes first.
        here: (M,) int64, the first of the two pixels, as (b H + y) W + x.
        there: (M,) int64, the second.
        sharers: (M,) how many visible crossings lie between the same two pixels.
    """

    edges: torch.Tensor
    edge: torch.Tensor
    axis: torch.Tensor
    line: torch.Tensor
    low: torch.Tensor
    here: torch.Tensor
    there: torch.Tensor
    sharers: torch.Tensor


def find_crossings(
    points: torch.Tensor,
    faces: torch.Tensor,
    edges: torch.Tensor,
    layer: torch.Tensor,
    size: tuple[int, int, int],
) -> Crossings:
    """Find the visible occlusion edges of B images; see `visible_faces` for the arguments.

    Edges with an end nearer than NEAR to the eye's plane are left out. Nothing of the result has a
    derivative: see `antialias`. `edges` is (E, 6) int32: see `Topology`, the vertices and faces of all meshes
    numbered through.
    """
    check_size(size)
    chosen, cells, hidden = opaque(
        functools.partial(_search, size=size), points.detach(), faces, edges, layer
    )
    cells = cells[(hidden == 0).nonzero().squeeze(1)].long()
    edge, axis, image, y, x = cells.unbind(1)
    _, height, width = size
    here = (image * height + y) * width + x
    _, inverse, counts = torch.unique(here * 2 + axis, return_inverse=True, return_counts=True)
    return Crossings(
        edges=edges[chosen, :2].long(),
        edge=edge,
        axis=axis,
        line=torch.where(axis == 0, y, x),
        low=torch.where(axis == 0, x, y),
        here=here,
        there=here + torch.where(axis == 0, 1, width),
        sharers=counts[inverse],
    )


def _search(
    points: torch.Tensor,
    faces: torch.Tensor,
    edges: torch.Tensor,
    layer: torch.Tensor,
    size: tuple[int, int, int],
) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Indices of the silhouette edges, all their crossings (M, 5), and which of these are hidden (M,)."""
    check_floats(points=(points, (None, 3)))
    check_table("faces", faces, (None, 3), len(points))
    check_table("edges", edges, (None, 6))
    check_table("layer", layer, (len(faces),), size[0])
    check_indices("vertices of edges", edges[:, :3], len(points))
    check_indices("opposite vertices of edges", edges[:, 3], len(points), -1)
    check_indices("first faces of edges", edges[:, 4], len(faces))
    check_indices("second faces of edges", edges[:, 5], len(faces), -1)
    kernels = _kernels(points.dtype)
    images, height, width = size
    flags = torch.empty(len(edges), dtype=torch.uint8, device=points.device)
    launch(kernels.find_silhouette, len(edges), points, edges, flags)
    chosen = flags.nonzero().squeeze(1)
    counts = torch.zeros(len(chosen), dtype=torch.int32, device=points.device)
    heads = torch.full((images, 2, height, width), -1, dtype=torch.int32, device=points.device)

    def cross(fill: int, ends: torch.Tensor, total: int) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        cells = torch.empty((total, 5), dtype=torch.int32, device=points.device)
        links, spots = cells.new_empty(total), points.new_empty(total, 3)
        given = points, edges, layer, chosen, fill, counts, ends, heads, links, cells, spots
        launch(kernels.cross_lines, len(chosen), *given)
        return cells, links, spots

    cross(0, counts, 0)
    ends = counts.cumsum(0).int()
    cells, links, spots = cross(1, ends, int(ends[-1]) if len(ends) else 0)
    hidden = torch.zeros(len(cells), dtype=torch.uint8, device=points.device)
    if len(cells):
        points, parts, origin = beyond_near(points, faces.long())
        given = points, parts.int(), origin, faces, layer, edges, chosen, heads, links, cells, spots, hidden
        launch(kernels.hide, len(parts), *given)
    return chosen, cells, hidden
