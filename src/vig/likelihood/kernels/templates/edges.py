"""Occlusion edges: crossings between two pixels, and the surfaces on both sides."""

import warp as wp

from vig.likelihood.kernels.layout import BEFORE_EDGE, BEHIND_EDGE
from vig_renderer.raster import FACE_MASK, NOTHING

behind_edge = real(BEHIND_EDGE)
before_edge = real(BEFORE_EDGE)
face_mask = wp.int64(FACE_MASK)
nothing = wp.int64(NOTHING)
half = real(0.5)
one = real(1.0)


@wp.struct
class Edge:
    """An occlusion edge from vertex i to j, seen from the face turned to the eye: screen points, normals
    in the camera's frame, and -1 for a fold or 1, see `edge_of`."""

    i: wp.int32
    j: wp.int32
    a: vec3
    b: vec3
    normal_a: vec3
    normal_b: vec3
    fold: real


@wp.struct
class Crossing:
    """Where an edge passes between two pixels in a row (axis 0) or column (axis 1), `share` of the edge's
    way from a to b and t of the way from the lower pixel. inside: fold, with the sign of the axis' side
    on which the edge's object lies. inner, outer: the pixels on its two sides, as places in the image
    and as image points; `found` where both are in the image."""

    axis: int
    share: real
    length: real
    t: real
    inside: real
    found: bool
    inner: wp.int32
    outer: wp.int32
    inner_pixel: vec2
    outer_pixel: vec2


@wp.struct
class Sides:
    """The surfaces that the two pixels show, with their (irradiance, 1 / depth) there. `crossed` unless
    the inner one is not the edge's, or what the outer one shows is not behind the edge."""

    crossed: bool
    has_behind: bool
    front: Surface
    behind: Surface
    front_seen: vec2
    behind_seen: vec2


@wp.func
def along(axis: int, u: real, v: real):
    """Return (x, y) of a point at u along an axis and v across it."""
    if axis == 0:
        return vec3(u, v, real(0.0))
    return vec3(v, u, real(0.0))


@wp.func
def edge_of(image: int, edge: int, mesh: Mesh, vertices: Vertices, facing: Occluding, eye: Eye):
    """An edge between a face turned to the eye and one turned away.

    Where both lie on one side of it, it is a fold into the object if the one beyond is nearer. Near the
    silhouette a fold lies between two edges that are both crossed: counted against them one crossing is
    left, and nothing jumps where a pair appears.
    """
    ends = Edge()
    ends.fold = one
    ends.i = mesh.edges[edge, 0]
    ends.j = mesh.edges[edge, 1]
    face = mesh.edges[edge, 2]
    # The three corners' numbers less the edge's two leave the third.
    apex = mesh.faces[face, 0] + mesh.faces[face, 1] + mesh.faces[face, 2] - ends.i - ends.j
    other = mesh.edges[edge, 4]
    # The edge is taken from the face that is turned to the eye, so that the object lies to one side of it.
    if facing.facing[image, face] == wp.uint8(0):
        ends.i = mesh.edges[edge, 1]
        ends.j = mesh.edges[edge, 0]
        swap = apex
        apex = other
        other = swap
    ends.a = vertices.screen[image, ends.i]
    ends.b = vertices.screen[image, ends.j]
    ends.normal_a = eye.rotation * vertices.normals[image, ends.i]
    ends.normal_b = eye.rotation * vertices.normals[image, ends.j]
    if mesh.edges[edge, 3] >= 0:
        to_apex = vertices.screen[image, apex] - ends.a
        to_other = vertices.screen[image, other] - ends.a
        if wp.dot(wp.cross(ends.b - ends.a, to_apex), to_other) < real(0.0):
            ends.fold = real(-1.0)
    return ends


@wp.func
def in_frame(edge: Edge, view: View):
    """Whether an edge is before the eye and its box touches the image."""
    a = edge.a
    b = edge.b
    return (
        wp.min(a[2], b[2]) > real(0.0)
        and wp.max(a[0], b[0]) >= real(0.0)
        and wp.min(a[0], b[0]) <= real(view.width)
        and wp.max(a[1], b[1]) >= real(0.0)
        and wp.min(a[1], b[1]) <= real(view.height)
    )


@wp.func
def lines_of(edge: Edge, axis: int, view: View):
    """The lines of pixels that an edge crosses: first, and one after the last."""
    count = view.height
    if axis == 1:
        count = view.width
    va = edge.a[1 - axis]
    vb = edge.b[1 - axis]
    # Pixel centres are at half-integers.
    first = wp.max(int(wp.ceil(wp.min(va, vb) - half)), 0)
    return first, wp.min(int(wp.ceil(wp.max(va, vb) - half)), count)


@wp.func
def crossing_of(edge: Edge, axis: int, line: int, view: View):
    """Where an edge crosses a line; u runs along the line, v across."""
    c = Crossing()
    c.axis = axis
    va = edge.a[1 - axis]
    c.length = edge.b[1 - axis] - va
    c.share = (real(line) + half - va) / c.length
    c.inside = edge.fold * wp.sign(c.length)
    size = view.width
    if axis == 1:
        c.inside = -c.inside
        size = view.height
    u = edge.a[axis] + c.share * (edge.b[axis] - edge.a[axis])
    # The last pixel whose centre is before the crossing.
    low = int(wp.floor(u - half))
    c.t = u - half - real(low)
    c.found = low >= 0 and low + 1 < size
    inner = low
    outer = low + 1
    if c.inside > real(0.0):
        inner = low + 1
        outer = low
    inner_spot = along(axis, real(inner) + half, real(line) + half)
    outer_spot = along(axis, real(outer) + half, real(line) + half)
    c.inner_pixel = vec2(inner_spot[0], inner_spot[1])
    c.outer_pixel = vec2(outer_spot[0], outer_spot[1])
    c.inner = int(inner_spot[1]) * view.width + int(inner_spot[0])
    c.outer = int(outer_spot[1]) * view.width + int(outer_spot[0])
    return c


@wp.func
def sides_of(
    image: int, edge: Edge, c: Crossing, mesh: Mesh, vertices: Vertices, keys: wp.array2d(dtype=wp.int64)
):
    sides = Sides()
    if not c.found:
        return sides
    inner_key = keys[image, c.inner]
    outer_key = keys[image, c.outer]
    if inner_key == nothing:
        return sides
    # q is linear along the edge on the screen, depth is not.
    edge_depth = one / ((one - c.share) * edge.a[2] + c.share * edge.b[2])
    sides.front = surface_of(image, int(inner_key & face_mask), mesh, vertices)
    sides.front_seen = seen_at(sides.front, c.inner_pixel)
    # The edge must be where the inner pixel's surface is, else another surface hides it there.
    ahead = edge_depth - one / sides.front_seen[1]
    sides.crossed = ahead <= before_edge and ahead >= -behind_edge
    sides.has_behind = outer_key != nothing
    if sides.crossed and sides.has_behind:
        sides.behind = surface_of(image, int(outer_key & face_mask), mesh, vertices)
        sides.behind_seen = seen_at(sides.behind, c.outer_pixel)
        sides.crossed = one / sides.behind_seen[1] >= edge_depth + behind_edge
    return sides
