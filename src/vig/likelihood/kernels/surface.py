"""Device functions of the visible surface in screen space: what is seen at a pixel, and how it pulls back.

A vertex on the screen is (x, y, q): its pixel coordinates and one over its depth. Over a face, q and q
times irradiance are affine in the pixel, and their ratio is the perspective-correct irradiance. So a pixel
costs two dot products and a division, and all pixels of a face together pull back through six sums.

A *row* is the derivative of one number with respect to every latent but albedo: its shape part and the rest,
each a padded Warp vector. The rest is azimuth, elevation, 9 light coefficients, the irradiance itself (with
it albedo's derivative is made, as the colour is albedo times irradiance), then the three framing numbers.
"""

import functools
from types import SimpleNamespace

import torch
import warp as wp

from vig.likelihood.kernels.groups import REST, argument_groups, kernel_types
from vig.scene.light import COSINE_LOBE, L_COUNT, Y00, Y1, Y2, Y20


@functools.cache
def surface_functions(dtype: torch.dtype, modes: int) -> SimpleNamespace:
    """Device functions for one scalar type and number of shape components."""
    t, groups = kernel_types(dtype, modes), argument_groups(dtype, modes)
    real, vec2, vec3, vec4, mat33 = t.real, t.vec2, t.vec3, t.vec4, t.mat33
    shape_row, rest_row, lobe_vector = t.shape_row, t.rest_row, t.lobe_vector
    Mesh, View, Vertices, Cotangents = groups.mesh, groups.view, groups.vertices, groups.cotangents
    azimuth, elevation, framing, light_at = (
        REST.at(name) for name in ("azimuth", "elevation", "framing", "light")
    )
    flat = real(COSINE_LOBE[0] * Y00)
    linear = real(COSINE_LOBE[1] * Y1)
    product = real(COSINE_LOBE[4] * Y2)
    polar = real(COSINE_LOBE[6] * Y20)

    @wp.struct
    class Eye:
        """One image's camera; rotation: camera_from_world."""

        rotation: mat33
        distance: real
        focal: real
        cx: real
        cy: real
        width: real

    @wp.func
    def eye_of(image: int, view: View):
        eye = Eye()
        eye.rotation = view.rotation[image]
        eye.distance = view.distance
        intrinsics = view.intrinsics[image]
        eye.focal = intrinsics[0]
        eye.cx = intrinsics[1]
        eye.cy = intrinsics[2]
        eye.width = real(view.width)
        return eye

    @wp.func
    def camera_point(eye: Eye, screen: vec3):
        """Where a point on the screen is in the camera's frame, metres."""
        depth = real(1.0) / screen[2]
        scale = depth / eye.focal
        return vec3((screen[0] - eye.cx) * scale, (screen[1] - eye.cy) * scale, depth)

    @wp.func
    def camera_cotangent(eye: Eye, screen: vec3, on_screen: vec3):
        """Pull a cotangent on (x, y, q) back to the camera's frame."""
        scale = eye.focal * screen[2]
        along = on_screen[0] * (screen[0] - eye.cx) + on_screen[1] * (screen[1] - eye.cy)
        return vec3(
            scale * on_screen[0], scale * on_screen[1], -screen[2] * (along + screen[2] * on_screen[2])
        )

    @wp.func
    def turned(eye: Eye, cotangent: vec3, arm: vec3):
        """Pull a cotangent on a vector that turns with the camera's rotation back to azimuth, elevation."""
        up = vec3(eye.rotation[0, 2], eye.rotation[1, 2], eye.rotation[2, 2])
        return vec2(-wp.dot(cotangent, wp.cross(up, arm)), cotangent[2] * arm[1] - cotangent[1] * arm[2])

    @wp.func
    def framed(eye: Eye, on_screen: vec3, screen: vec3):
        """Pull a cotangent on pixel coordinates back to the framing."""
        return vec3(
            on_screen[0] * eye.width,
            on_screen[1] * eye.width,
            on_screen[0] * (screen[0] - eye.cx) + on_screen[1] * (screen[1] - eye.cy),
        )

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
        inverse = real(1.0) / (bx * cy - by * cx)
        s.origin = vec2(a[0], a[1])
        s.by_second = vec2(cy * inverse, -cx * inverse)
        s.by_third = vec2(-by * inverse, bx * inverse)
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
        moved = s.lit_slope * lit + s.slope * depth
        by_q = vertices.irradiances[image, vertex] * lit + depth
        pulled = vec4(-moved[0], -moved[1], by_q, vertices.screen[image, vertex][2] * lit)
        wp.atomic_add(cotangents.on_corner, image, vertex, pulled)

    @wp.func
    def pull_surface(
        image: wp.int32,
        s: Surface,
        lit: real,
        lit_off: vec2,
        depth: real,
        depth_off: vec2,
        vertices: Vertices,
        cotangents: Cotangents,
    ):
        """Pull sums of cotangents on q times irradiance (lit) and on q (depth) back to the corners.

        lit, depth: summed over a face's pixels; lit_off, depth_off: each times the pixel's place from the
        first corner.
        """
        lit_b = wp.dot(s.by_second, lit_off)
        lit_c = wp.dot(s.by_third, lit_off)
        depth_b = wp.dot(s.by_second, depth_off)
        depth_c = wp.dot(s.by_third, depth_off)
        lit_a = lit - lit_b - lit_c
        depth_a = depth - depth_b - depth_c
        pull_corner(image, s.i, lit_a, depth_a, s, vertices, cotangents)
        pull_corner(image, s.j, lit_b, depth_b, s, vertices, cotangents)
        pull_corner(image, s.k, lit_c, depth_c, s, vertices, cotangents)

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
        """Pull a cotangent on the irradiance seen at one pixel back to the corners."""
        lit = on_seen / seen[1]
        depth = -lit * seen[0]
        off = pixel - s.origin
        pull_surface(image, s, lit, off * lit, depth, off * depth, vertices, cotangents)

    @wp.func
    def add_lobes(row: rest_row, change: lobe_vector):
        """Add to a row's light columns."""
        for i in range(L_COUNT):
            row[light_at + i] = row[light_at + i] + change[i]
        return row

    @wp.func
    def lobes(n: vec3):
        """A_l Y_lm(n) in a row's light columns."""
        row = rest_row()
        row[light_at + 0] = flat
        row[light_at + 1] = linear * n[1]
        row[light_at + 2] = linear * n[2]
        row[light_at + 3] = linear * n[0]
        row[light_at + 4] = product * n[0] * n[1]
        row[light_at + 5] = product * n[1] * n[2]
        row[light_at + 6] = polar * (real(3.0) * n[2] * n[2] - real(1.0))
        row[light_at + 7] = product * n[0] * n[2]
        row[light_at + 8] = real(0.5) * product * (n[0] * n[0] - n[1] * n[1])
        return row

    @wp.func
    def light_slope(light: rest_row, n: vec3):
        """d irradiance / d normal, the normal free in space; light stands in a row's light columns."""
        return vec3(
            linear * light[light_at + 3]
            + product
            * (light[light_at + 4] * n[1] + light[light_at + 7] * n[2] + light[light_at + 8] * n[0]),
            linear * light[light_at + 1]
            + product
            * (light[light_at + 4] * n[0] + light[light_at + 5] * n[2] - light[light_at + 8] * n[1]),
            linear * light[light_at + 2]
            + product * (light[light_at + 5] * n[1] + light[light_at + 7] * n[0])
            + real(6.0) * polar * light[light_at + 6] * n[2],
        )

    @wp.func
    def add_basis(row: shape_row, mesh: Mesh, vertex: wp.int32, cotangent: vec3):
        """Add what a cotangent on a vertex's place in the world is on the shape coefficients."""
        return (
            row
            + mesh.basis[vertex, 0] * cotangent[0]
            + mesh.basis[vertex, 1] * cotangent[1]
            + mesh.basis[vertex, 2] * cotangent[2]
        )

    @wp.func
    def moved(row: rest_row, eye: Eye, on_screen: vec3, screen: vec3):
        """Add a cotangent on a screen point, pulled back to pose and framing, to a row's rest."""
        point = camera_point(eye, screen)
        arm = vec3(point[0], point[1], point[2] - eye.distance)
        pose = turned(eye, camera_cotangent(eye, screen, on_screen), arm)
        shift = framed(eye, on_screen, screen)
        row[azimuth] = row[azimuth] + pose[0]
        row[elevation] = row[elevation] + pose[1]
        row[framing] = row[framing] + shift[0]
        row[framing + 1] = row[framing + 1] + shift[1]
        row[framing + 2] = row[framing + 2] + shift[2]
        return row

    return SimpleNamespace(
        Eye=Eye,
        Surface=Surface,
        eye_of=eye_of,
        camera_cotangent=camera_cotangent,
        turned=turned,
        surface_of=surface_of,
        seen_at=seen_at,
        pull_pixel=pull_pixel,
        lobes=lobes,
        add_lobes=add_lobes,
        light_slope=light_slope,
        add_basis=add_basis,
        moved=moved,
    )
