"""The visible surface: what is seen at a pixel and how it pulls back."""

import warp as wp


@wp.struct
class Surface:
    """A face on the screen. From its first corner, its other two weights grow by by_second, by_third a
    pixel; q by slope from base; q times irradiance by lit_slope from lit_base."""

    i: wp.int32
    j: wp.int32
    k: wp.int32
    origin: vec2
    by_second: vec2
    by_third: vec2
    lit_base: real
    lit_slope: vec2
    base: real
    slope: vec2


@wp.func
def surface_of(image: int, face: int, mesh: Mesh, vertices: Vertices):
    s = Surface()
    s.i = mesh.faces[face, 0]
    s.j = mesh.faces[face, 1]
    s.k = mesh.faces[face, 2]
    a = vertices.screen[image, s.i]
    b = vertices.screen[image, s.j]
    c = vertices.screen[image, s.k]
    bx = b[0] - a[0]
    by = b[1] - a[1]
    cx = c[0] - a[0]
    cy = c[1] - a[1]
    # Gradients of the barycentric weights of corners b and c on the screen (Cramer's rule).
    inverse = real(1.0) / (bx * cy - by * cx)
    s.origin = vec2(a[0], a[1])
    s.by_second = vec2(cy * inverse, -cx * inverse)
    s.by_third = vec2(-by * inverse, bx * inverse)
    # q and q times irradiance are linear on the screen: perspective-correct interpolation (Blinn 1992).
    lit_a = a[2] * vertices.irradiances[image, s.i]
    lit_b = b[2] * vertices.irradiances[image, s.j]
    lit_c = c[2] * vertices.irradiances[image, s.k]
    s.lit_base = lit_a
    s.lit_slope = s.by_second * (lit_b - lit_a) + s.by_third * (lit_c - lit_a)
    s.base = a[2]
    s.slope = s.by_second * (b[2] - a[2]) + s.by_third * (c[2] - a[2])
    return s


@wp.func
def seen_at(s: Surface, pixel: vec2):
    """(irradiance, 1 / depth) of the surface at a pixel."""
    off = pixel - s.origin
    q = s.base + wp.dot(s.slope, off)
    return vec2((s.lit_base + wp.dot(s.lit_slope, off)) / q, q)


@wp.func
def pull_corner(
    image: wp.int32,
    vertex: wp.int32,
    lit: real,
    depth: real,
    s: Surface,
    vertices: Vertices,
    cotangents: Cotangents,
):
    # A corner that moves carries the linear functions along: the value at the pixel changes against them.
    moved = s.lit_slope * lit + s.slope * depth
    by_q = vertices.irradiances[image, vertex] * lit + depth
    pulled = vec4(-moved[0], -moved[1], by_q, vertices.screen[image, vertex][2] * lit)
    wp.atomic_add(cotangents.on_corner, image, vertex, pulled)


@wp.func
def pull_pixel(
    image: wp.int32,
    s: Surface,
    pixel: vec2,
    seen: vec2,
    on_seen: real,
    vertices: Vertices,
    cotangents: Cotangents,
):
    """Pull a cotangent on the irradiance seen at one pixel back to the corners.

    lit and depth are the cotangents on q times irradiance and on q.
    """
    # irradiance = lit / q: d/d lit = 1 / q, d/d q = -irradiance / q.
    lit = on_seen / seen[1]
    depth = -lit * seen[0]
    off = pixel - s.origin
    lit_b = wp.dot(s.by_second, off * lit)
    lit_c = wp.dot(s.by_third, off * lit)
    depth_b = wp.dot(s.by_second, off * depth)
    depth_c = wp.dot(s.by_third, off * depth)
    pull_corner(image, s.i, lit - lit_b - lit_c, depth - depth_b - depth_c, s, vertices, cotangents)
    pull_corner(image, s.j, lit_b, depth_b, s, vertices, cotangents)
    pull_corner(image, s.k, lit_c, depth_c, s, vertices, cotangents)
