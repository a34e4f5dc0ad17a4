"""Kernels of `primitives/crossings.py` and their functions on homogeneous screen points."""

import torch
import warp as wp

from vig_renderer.raster import NEAR

near = real(NEAR)
half = real(0.5)
# A face hides a crossing where it is nearer by more than rounding.
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
    # Homogeneous 2-D rasterisation (Olano and Greer 1997): no division, so corners behind the eye do no harm.
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
    # Both faces on one side of the edge on the screen: it bounds them, whether silhouette or fold.
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
    crossing_count = wp.int32(0)
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
                at = ends[index] - counts[index] + crossing_count
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
                # One over depth is linear on the screen.
                depth = real(1.0) / ((real(1.0) - share) / a[2] + share / b[2])
                spots[at] = vec3(spot[0], spot[1], depth)
                # A list for each cell, its newest crossing first.
                links[at] = wp.atomic_exch(heads, image, axis, y, x, at)
            crossing_count = crossing_count + 1
    if fill == 0:
        counts[index] = crossing_count


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
        # A crossing of a cell lies up to a pixel after its centre along the axis.
        entry = vec2(half, half)
        entry[axis] = half + real(1.0)
        x0 = first_line(low[0] - entry[0])
        y0 = first_line(low[1] - entry[1])
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
