"""Device functions of the visible surface: its shading at a pixel, and how that moves with each latent.

A *row* is the derivative of one number with respect to every latent but albedo, one padded Warp vector:
K shape coefficients, azimuth, elevation, 9 light coefficients, then the irradiance itself (with it albedo's
derivative is made, as the colour is albedo times irradiance), then the three framing numbers.
"""

import functools
from dataclasses import dataclass
from types import SimpleNamespace

import torch
import warp as wp

from vig.render.device import initialise, scalar_type
from vig.scene.light import COSINE_LOBE, L_COUNT, Y00, Y1, Y2, Y20

FRAMING_COUNT = 3
"""Horizontal and vertical shift of the image in widths, log of its magnification."""


@dataclass(frozen=True)
class RowLayout:
    """Which column of a row is which, for K shape components."""

    modes: int

    @property
    def azimuth(self) -> int:
        return self.modes

    @property
    def elevation(self) -> int:
        return self.modes + 1

    @property
    def light(self) -> int:
        return self.modes + 2

    @property
    def irradiance(self) -> int:
        return self.light + L_COUNT

    @property
    def framing(self) -> int:
        return self.irradiance + 1

    @property
    def used(self) -> int:
        """Columns that hold a derivative; in the weighted copy of a row four more follow."""
        return self.framing + FRAMING_COUNT

    @property
    def width(self) -> int:
        """Columns with padding to whole vector registers."""
        return -(-(self.used + 4) // 16) * 16


@functools.cache
def surface_functions(dtype: torch.dtype, modes: int) -> SimpleNamespace:
    """Types and device functions for one scalar type and number of shape components."""
    initialise()
    real = scalar_type(dtype)
    layout = RowLayout(modes)
    vec2, vec3 = wp.types.vector(2, real), wp.types.vector(3, real)
    mat33 = wp.types.matrix((3, 3), real)
    row_type = wp.types.vector(layout.width, real)
    normal_jacobian = wp.types.vector(modes + 1, real)
    modes_, azimuth, elevation = layout.modes, layout.azimuth, layout.elevation
    light_at, irradiance_at, framing = layout.light, layout.irradiance, layout.framing
    flat = real(COSINE_LOBE[0] * Y00)
    linear = real(COSINE_LOBE[1] * Y1)
    product = real(COSINE_LOBE[4] * Y2)
    polar = real(COSINE_LOBE[6] * Y20)

    @wp.struct
    class View:
        """One image's camera."""

        rotation: mat33
        distance: real
        focal: real
        cx: real
        cy: real
        width: real

    @wp.func
    def view_of(rotation: mat33, distance: real, intrinsics: vec3, width: int):
        view = View()
        view.rotation = rotation
        view.distance = distance
        view.focal = intrinsics[0]
        view.cx = intrinsics[1]
        view.cy = intrinsics[2]
        view.width = real(width)
        return view

    @wp.func
    def project(view: View, point: vec3):
        return vec2(
            view.focal * point[0] / point[2] + view.cx,
            view.focal * point[1] / point[2] + view.cy,
        )

    @wp.func
    def screen_cotangent(view: View, point: vec3, on_screen: vec2):
        """Pull a cotangent on a point's pixel coordinates back to its camera coordinates."""
        scale = view.focal / point[2]
        x = on_screen[0] * scale
        y = on_screen[1] * scale
        return vec3(x, y, -(x * point[0] + y * point[1]) / point[2])

    @wp.func
    def add_motion(
        row: row_type,
        view: View,
        cotangent: vec3,
        point: vec3,
        basis_x: row_type,
        basis_y: row_type,
        basis_z: row_type,
    ):
        """Add cotangent . d(point) / d(latents), all in the camera frame; basis in the world frame."""
        world = wp.transpose(view.rotation) * cotangent
        result = row + basis_x * world[0] + basis_y * world[1] + basis_z * world[2]
        arm = vec3(point[0], point[1], point[2] - view.distance)
        up = vec3(view.rotation[0, 2], view.rotation[1, 2], view.rotation[2, 2])
        result[azimuth] = result[azimuth] - wp.dot(cotangent, wp.cross(up, arm))
        result[elevation] = result[elevation] + cotangent[2] * arm[1] - cotangent[1] * arm[2]
        return result

    @wp.func
    def add_framing(row: row_type, view: View, on_screen: vec2, pixel: vec2):
        """Add on_screen . d(pixel) / d(framing)."""
        row[framing] = row[framing] + on_screen[0] * view.width
        row[framing + 1] = row[framing + 1] + on_screen[1] * view.width
        row[framing + 2] = (
            row[framing + 2] + on_screen[0] * (pixel[0] - view.cx) + on_screen[1] * (pixel[1] - view.cy)
        )
        return row

    @wp.struct
    class Hit:
        """The surface seen along one ray."""

        i: wp.int32
        j: wp.int32
        k: wp.int32
        barycentric: vec3
        point: vec3
        irradiance: real
        screen_gradient: vec2

    @wp.func
    def hit_of(
        view: View,
        image: int,
        face: int,
        pixel: vec2,
        points: wp.array2d(dtype=vec3),
        irradiances: wp.array2d(dtype=real),
        faces: wp.array2d(dtype=wp.int32),
    ):
        hit = Hit()
        hit.i = faces[face, 0]
        hit.j = faces[face, 1]
        hit.k = faces[face, 2]
        a = points[image, hit.i]
        b = points[image, hit.j]
        c = points[image, hit.k]
        ea = wp.cross(b, c)
        eb = wp.cross(c, a)
        ec = wp.cross(a, b)
        ray = vec3((pixel[0] - view.cx) / view.focal, (pixel[1] - view.cy) / view.focal, real(1.0))
        weights = vec3(wp.dot(ray, ea), wp.dot(ray, eb), wp.dot(ray, ec))
        inverse = real(1.0) / (weights[0] + weights[1] + weights[2])
        hit.barycentric = weights * inverse
        hit.point = ray * (wp.dot(a, ea) * inverse)
        irr = vec3(
            irradiances[image, hit.i],
            irradiances[image, hit.j],
            irradiances[image, hit.k],
        )
        hit.irradiance = wp.dot(hit.barycentric, irr)
        change = vec3(irr[0] - hit.irradiance, irr[1] - hit.irradiance, irr[2] - hit.irradiance)
        scale = inverse / view.focal
        hit.screen_gradient = vec2(
            (ea[0] * change[0] + eb[0] * change[1] + ec[0] * change[2]) * scale,
            (ea[1] * change[0] + eb[1] * change[1] + ec[1] * change[2]) * scale,
        )
        return hit

    @wp.func
    def hit_row(
        view: View,
        image: int,
        hit: Hit,
        pixel: vec2,
        attributes: wp.array2d(dtype=row_type),
        basis: wp.array2d(dtype=row_type),
    ):
        """d irradiance at a fixed pixel: what its material point changes, less what slides past."""
        u = hit.barycentric[0]
        v = hit.barycentric[1]
        w = hit.barycentric[2]
        row = attributes[image, hit.i] * u + attributes[image, hit.j] * v + attributes[image, hit.k] * w
        slide = -hit.screen_gradient
        row = add_motion(
            row,
            view,
            screen_cotangent(view, hit.point, slide),
            hit.point,
            basis[0, hit.i] * u + basis[0, hit.j] * v + basis[0, hit.k] * w,
            basis[1, hit.i] * u + basis[1, hit.j] * v + basis[1, hit.k] * w,
            basis[2, hit.i] * u + basis[2, hit.j] * v + basis[2, hit.k] * w,
        )
        return add_framing(row, view, slide, pixel)

    @wp.func
    def shade(
        normal: vec3,
        inverse_length: real,
        light: wp.array2d(dtype=real),
        image: int,
        dn_x: normal_jacobian,
        dn_y: normal_jacobian,
        dn_z: normal_jacobian,
    ):
        """A vertex's attribute: d irradiance / d shape and light, and the irradiance (Eq. 1 with SH)."""
        x = normal[0]
        y = normal[1]
        z = normal[2]
        row = row_type()
        row[light_at + 0] = flat
        row[light_at + 1] = linear * y
        row[light_at + 2] = linear * z
        row[light_at + 3] = linear * x
        row[light_at + 4] = product * x * y
        row[light_at + 5] = product * y * z
        row[light_at + 6] = polar * (real(3.0) * z * z - real(1.0))
        row[light_at + 7] = product * x * z
        row[light_at + 8] = real(0.5) * product * (x * x - y * y)
        total = real(0.0)
        for i in range(9):
            total = total + row[light_at + i] * light[image, i]
        if total <= real(0.0):
            return row_type()
        row[irradiance_at] = total
        gradient = vec3(
            linear * light[image, 3]
            + product * (light[image, 4] * y + light[image, 7] * z + light[image, 8] * x),
            linear * light[image, 1]
            + product * (light[image, 4] * x + light[image, 5] * z - light[image, 8] * y),
            linear * light[image, 2]
            + product * (light[image, 5] * y + light[image, 7] * x)
            + real(6.0) * polar * light[image, 6] * z,
        )
        tangent = (gradient - normal * wp.dot(gradient, normal)) * inverse_length
        for mode in range(modes_):
            row[mode] = (
                tangent[0] * dn_x[mode + 1] + tangent[1] * dn_y[mode + 1] + tangent[2] * dn_z[mode + 1]
            )
        return row

    return SimpleNamespace(
        real=real,
        vec2=vec2,
        vec3=vec3,
        mat33=mat33,
        row_type=row_type,
        normal_jacobian=normal_jacobian,
        layout=layout,
        View=View,
        Hit=Hit,
        view_of=view_of,
        project=project,
        screen_cotangent=screen_cotangent,
        add_motion=add_motion,
        add_framing=add_framing,
        hit_of=hit_of,
        hit_row=hit_row,
        shade=shade,
    )
