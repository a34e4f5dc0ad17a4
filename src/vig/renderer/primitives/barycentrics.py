"""Perspective-correct barycentric weights of the seen faces, and their derivatives along the screen."""

import functools
from types import SimpleNamespace
from typing import Any

import torch
import warp as wp

from vig.renderer.device import initialise, scalar_type
from vig.renderer.kernel_calls import check_floats, check_table, kernel_module, launch, opaque


@functools.cache
def _kernels(dtype: torch.dtype) -> SimpleNamespace:
    initialise()
    real = scalar_type(dtype)
    vec2, vec3 = wp.types.vector(2, real), wp.types.vector(3, real)
    vec9 = wp.types.vector(9, real)
    module = kernel_module("barycentrics", dtype)

    @wp.struct
    class Edges:
        """Edge functions n of the ray through a pixel, and their derivatives along x and y."""

        n: vec3
        nx: vec3
        ny: vec3

    @wp.func
    def cross(a: vec2, b: vec2):
        return a[0] * b[1] - a[1] * b[0]

    @wp.func
    def edges_at(oa: vec2, ob: vec2, oc: vec2, z: vec3):
        """o: corners relative to the pixel times depth z; along x a corner's o moves by (-z, 0)."""
        e = Edges()
        e.n = vec3(cross(ob, oc), cross(oc, oa), cross(oa, ob))
        e.nx = vec3(z[2] * ob[1] - z[1] * oc[1], z[0] * oc[1] - z[2] * oa[1], z[1] * oa[1] - z[0] * ob[1])
        e.ny = vec3(z[1] * oc[0] - z[2] * ob[0], z[2] * oa[0] - z[0] * oc[0], z[0] * ob[0] - z[1] * oa[0])
        return e

    @wp.func
    def total(v: vec3):
        return v[0] + v[1] + v[2]

    @wp.struct
    class Ray:
        """The ray through a pixel's centre (x, y), and the three corners of the face that it meets.

        o: corners relative to the pixel times their depths z. w: the weights, 1 / total(edges.n) times
        edges.n, and their derivatives along x and y.
        """

        x: real
        y: real
        oa: vec2
        ob: vec2
        oc: vec2
        z: vec3
        edges: Edges
        inverse: real
        w: vec3
        wx: vec3
        wy: vec3

    @wp.func
    def from_pixel(point: vec3, x: real, y: real):
        return vec2(point[0] - x * point[2], point[1] - y * point[2])

    @wp.func
    def ray_at(
        points: wp.array(dtype=vec3),
        corners: wp.array2d(dtype=wp.int32),
        pixels: wp.array2d(dtype=wp.int32),
        row: int,
    ):
        r = Ray()
        a = points[corners[row, 0]]
        b = points[corners[row, 1]]
        c = points[corners[row, 2]]
        r.x = real(pixels[row, 0]) + real(0.5)
        r.y = real(pixels[row, 1]) + real(0.5)
        r.oa = from_pixel(a, r.x, r.y)
        r.ob = from_pixel(b, r.x, r.y)
        r.oc = from_pixel(c, r.x, r.y)
        r.z = vec3(a[2], b[2], c[2])
        e = edges_at(r.oa, r.ob, r.oc, r.z)
        r.edges = e
        r.inverse = real(1.0) / total(e.n)
        r.w = e.n * r.inverse
        r.wx = (e.nx - r.w * total(e.nx)) * r.inverse
        r.wy = (e.ny - r.w * total(e.ny)) * r.inverse
        return r

    @wp.kernel(module=module)
    def forward(
        points: wp.array(dtype=vec3),
        corners: wp.array2d(dtype=wp.int32),
        pixels: wp.array2d(dtype=wp.int32),
        result: wp.array(dtype=vec9),
    ):
        row = wp.tid()
        r = ray_at(points, corners, pixels, row)
        w = r.w
        wx = r.wx
        wy = r.wy
        result[row] = vec9(w[0], w[1], w[2], wx[0], wx[1], wx[2], wy[0], wy[1], wy[2])

    @wp.kernel(module=module)
    def tangent(
        points: wp.array(dtype=vec3),
        corners: wp.array2d(dtype=wp.int32),
        pixels: wp.array2d(dtype=wp.int32),
        moved: wp.array(dtype=vec3),
        result: wp.array(dtype=vec9),
    ):
        row = wp.tid()
        r = ray_at(points, corners, pixels, row)
        oa = r.oa
        ob = r.ob
        oc = r.oc
        e = r.edges
        da = moved[corners[row, 0]]
        db = moved[corners[row, 1]]
        dc = moved[corners[row, 2]]
        ta = from_pixel(da, r.x, r.y)
        tb = from_pixel(db, r.x, r.y)
        tc = from_pixel(dc, r.x, r.y)
        dz = vec3(da[2], db[2], dc[2])
        # Every edge function is bilinear in two corners: the product rule, three terms of it at once.
        dn = vec3(cross(tb, oc) + cross(ob, tc), cross(tc, oa) + cross(oc, ta), cross(ta, ob) + cross(oa, tb))
        by_place = edges_at(ta, tb, tc, r.z)
        by_depth = edges_at(oa, ob, oc, dz)
        dnx = by_place.nx + by_depth.nx
        dny = by_place.ny + by_depth.ny
        inverse = r.inverse
        w = r.w
        wx = r.wx
        wy = r.wy
        dw = (dn - w * total(dn)) * inverse
        dwx = (dnx - dw * total(e.nx) - w * total(dnx) - wx * total(dn)) * inverse
        dwy = (dny - dw * total(e.ny) - w * total(dny) - wy * total(dn)) * inverse
        result[row] = vec9(dw[0], dw[1], dw[2], dwx[0], dwx[1], dwx[2], dwy[0], dwy[1], dwy[2])

    @wp.kernel(module=module)
    def backward(
        points: wp.array(dtype=vec3),
        corners: wp.array2d(dtype=wp.int32),
        pixels: wp.array2d(dtype=wp.int32),
        cotangents: wp.array(dtype=vec9),
        result: wp.array(dtype=vec3),
    ):
        row = wp.tid()
        r = ray_at(points, corners, pixels, row)
        oa = r.oa
        ob = r.ob
        oc = r.oc
        z = r.z
        x = r.x
        y = r.y
        e = r.edges
        inverse = r.inverse
        w = r.w
        g = cotangents[row]
        gx = vec3(g[3], g[4], g[5])
        gy = vec3(g[6], g[7], g[8])
        gw = vec3(g[0], g[1], g[2]) - (gx * total(e.nx) + gy * total(e.ny)) * inverse
        on_total = -(wp.dot(gw, w) + wp.dot(gx, r.wx) + wp.dot(gy, r.wy)) * inverse
        n = gw * inverse + vec3(on_total, on_total, on_total)
        tx = wp.dot(gx, w)
        ty = wp.dot(gy, w)
        nx = (gx - vec3(tx, tx, tx)) * inverse
        ny = (gy - vec3(ty, ty, ty)) * inverse
        # What each corner's place (times depth) and depth take from the nine edge functions.
        on_a = vec2(
            n[2] * ob[1] - n[1] * oc[1] + ny[1] * z[2] - ny[2] * z[1],
            n[1] * oc[0] - n[2] * ob[0] + nx[2] * z[1] - nx[1] * z[2],
        )
        on_b = vec2(
            n[0] * oc[1] - n[2] * oa[1] + ny[2] * z[0] - ny[0] * z[2],
            n[2] * oa[0] - n[0] * oc[0] + nx[0] * z[2] - nx[2] * z[0],
        )
        on_c = vec2(
            n[1] * oa[1] - n[0] * ob[1] + ny[0] * z[1] - ny[1] * z[0],
            n[0] * ob[0] - n[1] * oa[0] + nx[1] * z[0] - nx[0] * z[1],
        )
        on_z = vec3(
            nx[1] * oc[1] - nx[2] * ob[1] + ny[2] * ob[0] - ny[1] * oc[0],
            nx[2] * oa[1] - nx[0] * oc[1] + ny[0] * oc[0] - ny[2] * oa[0],
            nx[0] * ob[1] - nx[1] * oa[1] + ny[1] * oa[0] - ny[0] * ob[0],
        )
        wp.atomic_add(result, corners[row, 0], vec3(on_a[0], on_a[1], on_z[0] - x * on_a[0] - y * on_a[1]))
        wp.atomic_add(result, corners[row, 1], vec3(on_b[0], on_b[1], on_z[1] - x * on_b[0] - y * on_b[1]))
        wp.atomic_add(result, corners[row, 2], vec3(on_c[0], on_c[1], on_z[2] - x * on_c[0] - y * on_c[1]))

    return SimpleNamespace(forward=forward, tangent=tangent, backward=backward)


def _forward(points: torch.Tensor, corners: torch.Tensor, pixels: torch.Tensor) -> torch.Tensor:
    result = points.new_empty(len(corners), 9)
    launch(_kernels(points.dtype).forward, len(corners), points, corners, pixels, result)
    return result


def _tangent(
    points: torch.Tensor, corners: torch.Tensor, pixels: torch.Tensor, moved: torch.Tensor
) -> torch.Tensor:
    result = points.new_empty(len(corners), 9)
    launch(_kernels(points.dtype).tangent, len(corners), points, corners, pixels, moved, result)
    return result


def _backward(
    points: torch.Tensor, corners: torch.Tensor, pixels: torch.Tensor, cotangents: torch.Tensor
) -> torch.Tensor:
    result = torch.zeros_like(points)
    launch(_kernels(points.dtype).backward, len(corners), points, corners, pixels, cotangents, result)
    return result


class _Barycentrics(torch.autograd.Function):
    @staticmethod
    def forward(points: torch.Tensor, corners: torch.Tensor, pixels: torch.Tensor) -> torch.Tensor:
        check_floats(points=(points, (None, 3)))
        check_table("corners", corners, (None, 3), len(points))
        check_table("pixels", pixels, (len(corners), 2))
        return _forward(points, corners, pixels)

    @staticmethod
    def setup_context(ctx: Any, inputs: tuple[torch.Tensor, ...], output: torch.Tensor) -> None:
        ctx.save_for_backward(*inputs)
        ctx.save_for_forward(*inputs)

    @staticmethod
    def backward(ctx: Any, cotangents: torch.Tensor) -> Any:
        return opaque(_backward, *ctx.saved_tensors, cotangents), None, None

    @staticmethod
    def jvp(ctx: Any, moved: torch.Tensor, *_: Any) -> torch.Tensor:
        return opaque(_tangent, *ctx.saved_tensors, moved)


def barycentrics(points: torch.Tensor, corners: torch.Tensor, pixels: torch.Tensor) -> torch.Tensor:
    """Weights of the corners of N seen faces at the centres of N pixels, and how they change on the screen.

    points (V, 3): homogeneous screen points (x z, y z, z). corners (N, 3) int32: the faces' vertices.
    pixels (N, 2) int32: column and row. Result (N, 3, 3): the perspective-correct weights, their derivatives
    per pixel to the right, and per pixel downwards. Differentiable in points. Raises ValueError for other
    shapes and types and for corners that are not there.
    """
    return _Barycentrics.apply(points.contiguous(), corners.contiguous(), pixels.contiguous()).view(-1, 3, 3)
