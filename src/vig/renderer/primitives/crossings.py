"""Where visible occlusion edges pass between the centres of neighbouring pixels.

An edge of a mesh is a *rim* where its two faces lie on the same side of it on the screen, or where there is
one face only. Where a rim crosses the line between two neighbouring pixel centres, the faces around are
searched for one that hides the crossing; those that none hides are kept. This is exact for the polygons:
no tolerance in metres, no normals, no winding. Surfaces that pierce each other have no rim where they do.
"""

import functools
from dataclasses import dataclass
from types import SimpleNamespace

import torch
import warp as wp

from vig.checks import check_indices
from vig.renderer.device import initialise, scalar_type
from vig.renderer.kernel_calls import check_floats, check_size, check_table, kernel_module, launch, opaque
from vig.renderer.raster import NEAR


@functools.cache
def _screen_functions(dtype: torch.dtype) -> SimpleNamespace:
    """Types and device functions on homogeneous screen points."""
    initialise()
    real = scalar_type(dtype)
    vec2, vec3 = wp.types.vector(2, real), wp.types.vector(3, real)
    near = real(NEAR)

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
    def clipped(a: vec3, b: vec3):
        """Where the segment from a (before the near plane) to b (beyond it) crosses that plane, in pixels."""
        share = (near - a[2]) / (b[2] - a[2])
        return vec2(a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1])) / near

    @wp.func
    def seen_of_edge(a: vec3, b: vec3, low: vec2, high: vec2):
        """Widen a box by the part of a side that lies beyond the near plane."""
        p = vec2(real(0.0), real(0.0))
        q = vec2(real(0.0), real(0.0))
        if a[2] < near and b[2] < near:
            return low, high
        if a[2] < near:
            p = clipped(a, b)
        else:
            p = vec2(a[0], a[1]) / a[2]
        if b[2] < near:
            q = clipped(b, a)
        else:
            q = vec2(b[0], b[1]) / b[2]
        return wp.min(low, wp.min(p, q)), wp.max(high, wp.max(p, q))

    @wp.func
    def box_of(a: vec3, b: vec3, c: vec3):
        """Bounding box in pixels of what lies beyond the near plane; empty where nothing does."""
        if wp.min(a[2], wp.min(b[2], c[2])) >= near:
            pa = vec2(a[0], a[1]) / a[2]
            pb = vec2(b[0], b[1]) / b[2]
            pc = vec2(c[0], c[1]) / c[2]
            return wp.min(pa, wp.min(pb, pc)), wp.max(pa, wp.max(pb, pc))
        low = vec2(real(1.0e9), real(1.0e9))
        high = vec2(real(-1.0e9), real(-1.0e9))
        low, high = seen_of_edge(a, b, low, high)
        low, high = seen_of_edge(b, c, low, high)
        low, high = seen_of_edge(c, a, low, high)
        return low, high

    @wp.func
    def first_line(low: real):
        """The first row or column from `low` on, clamped before it becomes a whole number."""
        return int(wp.ceil(wp.max(low, real(0.0))))

    @wp.func
    def last_line(high: real, count: int):
        """The last row or column up to `high`, clamped before it becomes a whole number."""
        return int(wp.floor(wp.min(high, real(count - 1))))

    return SimpleNamespace(
        real=real,
        vec2=vec2,
        vec3=vec3,
        weights_at=weights_at,
        depth_inside=depth_inside,
        box_of=box_of,
        first_line=first_line,
        last_line=last_line,
    )


@functools.cache
def _kernels(dtype: torch.dtype) -> SimpleNamespace:
    f = _screen_functions(dtype)
    real, vec2, vec3 = f.real, f.vec2, f.vec3
    weights_at, depth_inside, box_of = f.weights_at, f.depth_inside, f.box_of
    first_line, last_line = f.first_line, f.last_line
    module = kernel_module("crossings", dtype)
    near, half = real(NEAR), real(0.5)
    nearer = real(1.0 - (1e-5 if dtype == torch.float32 else 1e-9))

    @wp.func
    def side(a: vec3, b: vec3, c: vec3):
        """On which side of the line from a to b, on the screen, the face with third vertex c lies."""
        x = a[0] / a[2]
        y = a[1] / a[2]
        bx = b[0] - x * b[2]
        by = b[1] - y * b[2]
        cx = c[0] - x * c[2]
        cy = c[1] - y * c[2]
        return bx * cy - by * cx

    @wp.kernel(module=module)
    def find_silhouette(
        points: wp.array(dtype=vec3),
        edges: wp.array2d(dtype=wp.int32),
        rims: wp.array(dtype=wp.uint8),
    ):
        edge = wp.tid()
        rims[edge] = wp.uint8(0)
        a = points[edges[edge, 0]]
        b = points[edges[edge, 1]]
        if a[2] < near or b[2] < near:
            return
        if edges[edge, 3] < 0:
            rims[edge] = wp.uint8(1)
            return
        here = side(a, b, points[edges[edge, 2]])
        there = side(a, b, points[edges[edge, 3]])
        if (here > real(0.0) and there > real(0.0)) or (here < real(0.0) and there < real(0.0)):
            rims[edge] = wp.uint8(1)

    @wp.kernel(module=module)
    def cross_lines(
        points: wp.array(dtype=vec3),
        edges: wp.array2d(dtype=wp.int32),
        layer: wp.array(dtype=wp.int32),
        rims: wp.array(dtype=wp.int64),
        fill: wp.int32,
        counts: wp.array(dtype=wp.int32),
        ends: wp.array(dtype=wp.int32),
        heads: wp.array4d(dtype=wp.int32),
        links: wp.array(dtype=wp.int32),
        cells: wp.array2d(dtype=wp.int32),
        spots: wp.array(dtype=vec3),
    ):
        """First time: count each rim's crossings. Second time: write them, and link those of one cell."""
        index = wp.tid()
        edge = int(rims[index])
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
        faces: wp.array2d(dtype=wp.int32),
        layer: wp.array(dtype=wp.int32),
        edges: wp.array2d(dtype=wp.int32),
        rims: wp.array(dtype=wp.int64),
        heads: wp.array4d(dtype=wp.int32),
        links: wp.array(dtype=wp.int32),
        cells: wp.array2d(dtype=wp.int32),
        spots: wp.array(dtype=vec3),
        hidden: wp.array(dtype=wp.uint8),
    ):
        """Mark the crossings that a face lies before. A cell holds the crossings after its pixel's centre."""
        face = wp.tid()
        a = points[faces[face, 0]]
        b = points[faces[face, 1]]
        c = points[faces[face, 2]]
        image = layer[face]
        low, high = box_of(a, b, c)
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
                        edge = int(rims[cells[at, 0]])
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
    """Rims of B images of H x W, and their M visible crossings with the lines between pixel centres.

    rims (R, 2) int64: the vertices a and b of each rim, visible or not. rim (M,) int64: which rim crosses.
    axis (M,) int64: 0 between neighbours in a row, 1 in a column. line (M,): which row (axis 0) or column.
    low (M,): the neighbour's column (row) that comes first. here, there (M,) int64: the two pixels, first
    and second, as (b H + y) W + x. sharers (M,): how many visible crossings lie between the same two pixels.
    """

    rims: torch.Tensor
    rim: torch.Tensor
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
    """Find the visible occlusion edges of B images.

    points (V, 3): homogeneous screen points. faces (F, 3), edges (E, 6) int32: see `Topology`, the vertices
    and faces of all meshes numbered through. layer (F,) int32: the image of each face. size: (B, H, W).
    Edges with an end nearer than NEAR to the eye's plane are left out. Nothing of the result has a
    derivative: see `antialias`. Raises ValueError for other shapes and types and for indices of vertices,
    faces or images that are not there.
    """
    check_size(size)
    rims, cells, hidden = opaque(functools.partial(_search, size=size), points.detach(), faces, edges, layer)
    cells = cells[(hidden == 0).nonzero().squeeze(1)].long()
    rim, axis, image, y, x = cells.unbind(1)
    _, height, width = size
    here = (image * height + y) * width + x
    _, inverse, counts = torch.unique(here * 2 + axis, return_inverse=True, return_counts=True)
    return Crossings(
        rims=edges[rims, :2].long(),
        rim=rim,
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
    """Indices of the rims, all their crossings (M, 5), and which of these are hidden (M,)."""
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
        launch(
            kernels.hide, len(faces), points, faces, layer, edges, chosen, heads, links, cells, spots, hidden
        )
    return chosen, cells, hidden
