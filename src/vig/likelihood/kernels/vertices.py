"""Kernels of the vertices: from a point's numbers to places, normals and irradiance, and back again."""

import functools
from types import SimpleNamespace

import torch
import warp as wp

from vig.likelihood.kernels.rings import ring_functions
from vig.likelihood.kernels.surface import AZIMUTH, ELEVATION, LIGHT
from vig.renderer.raster import NEAR


def module_name(room: str, dtype: torch.dtype, modes: int) -> str:
    """The name under which kernels of this scalar type and width are cached."""
    return f"vig_{room}_{str(dtype).removeprefix('torch.')}_{modes}"


@functools.cache
def vertex_kernels(dtype: torch.dtype, modes: int) -> SimpleNamespace:
    """The kernels for one scalar type and number of shape components, compiled at first use.

    Points are rows of (1, latents in their order, framing). Each vertex has a ring of (neighbour, next,
    previous): the other two corners of its faces in order, a missing one being the vertex itself.
    """
    f = ring_functions(dtype, modes)
    real, vec3, vec4, mat33 = f.real, f.vec3, f.vec4, f.mat33
    ring_normal, ring_row, ring_pull = f.ring_normal, f.ring_row, f.ring_pull
    shape_row, rest_row = f.shape_row, f.rest_row
    eye_of, camera_cotangent, turned = f.eye_of, f.camera_cotangent, f.turned
    lobes, add_lobes, lobe_vector = f.lobes, f.add_lobes, f.lobe_vector
    light_slope, moved, irradiance_at = f.light_slope, f.moved, f.irradiance_at
    modes_ = modes
    near = real(NEAR)
    azimuth_at, light_from, framing_from = modes + 1, modes + 6, modes + 15
    azimuth, elevation, light_at = AZIMUTH, ELEVATION, LIGHT
    module = module_name("vertices", dtype, modes)

    @wp.kernel(module=module)
    def look(
        points: wp.array2d(dtype=real),
        camera: vec3,
        width: real,
        rotation: wp.array(dtype=mat33),
        intrinsics: wp.array(dtype=vec3),
        light: wp.array(dtype=rest_row),
    ):
        """The camera (focal length, cx, cy of the image as it is) and the light of each point."""
        image = wp.tid()
        sa = wp.sin(points[image, azimuth_at])
        ca = wp.cos(points[image, azimuth_at])
        se = wp.sin(points[image, azimuth_at + 1])
        ce = wp.cos(points[image, azimuth_at + 1])
        rotation[image] = mat33(ca, sa, real(0.0), se * sa, -se * ca, -ce, -ce * sa, ce * ca, -se)
        intrinsics[image] = vec3(
            camera[0] * wp.exp(points[image, framing_from + 2]),
            camera[1] + points[image, framing_from] * width,
            camera[2] + points[image, framing_from + 1] * width,
        )
        row = rest_row()
        for i in range(9):
            row[light_at + i] = points[image, light_from + i]
        light[image] = row

    @wp.kernel(module=module)
    def place(
        world: wp.array2d(dtype=vec3),
        rotation: wp.array(dtype=mat33),
        intrinsics: wp.array(dtype=vec3),
        target: vec3,
        distance: real,
        chunk: int,
        screen: wp.array2d(dtype=vec3),
    ):
        """Vertices on the screen, q = 0 for one at or behind the eye."""
        image, part = wp.tid()
        turn = rotation[image]
        lens = intrinsics[image]
        first = part * chunk
        for vertex in range(first, wp.min(first + chunk, world.shape[1])):
            point = turn * (world[image, vertex] - target)
            depth = point[2] + distance
            q = real(0.0)
            if depth > near:
                q = real(1.0) / depth
            scale = lens[0] * q
            screen[image, vertex] = vec3(point[0] * scale + lens[1], point[1] * scale + lens[2], q)

    @wp.kernel(module=module)
    def shade(
        world: wp.array2d(dtype=vec3),
        used: wp.array2d(dtype=wp.uint8),
        light: wp.array(dtype=rest_row),
        ring_start: wp.array(dtype=wp.int32),
        ring: wp.array2d(dtype=wp.int32),
        basis: wp.array2d(dtype=shape_row),
        shadowed: int,
        lobe_changes: wp.array2d(dtype=lobe_vector),
        shadow_rates: wp.array3d(dtype=real),
        chunk: int,
        differentiate: int,
        normals: wp.array2d(dtype=vec3),
        inverse_lengths: wp.array2d(dtype=real),
        irradiances: wp.array2d(dtype=real),
        shape_rows: wp.array2d(dtype=shape_row),
        rest_rows: wp.array2d(dtype=rest_row),
    ):
        """Normals and irradiance of the vertices in use; with differentiate = 2 its row of derivatives.

        With self-shadow, lobe_changes are added to the nine lobes, and shadow_rates (K + 1, V) to the
        irradiance's derivatives with respect to shape.
        """
        image, part = wp.tid()
        shining = light[image]
        first = part * chunk
        for vertex in range(first, wp.min(first + chunk, used.shape[1])):
            if used[image, vertex] != wp.uint8(0):
                normal = ring_normal(image, vertex, world, ring_start, ring)
                length = wp.length(normal)
                inverse = real(0.0)
                if length > real(0.0):
                    inverse = real(1.0) / length
                normal = normal * inverse
                row = lobes(normal)
                if shadowed != 0:
                    row = add_lobes(row, lobe_changes[image, vertex])
                total = wp.dot(row, shining)
                normals[image, vertex] = normal
                inverse_lengths[image, vertex] = inverse
                irradiances[image, vertex] = wp.max(total, real(0.0))
                if differentiate > 1:
                    tangent = vec3()
                    if total > real(0.0):
                        slope = light_slope(shining, normal)
                        tangent = (slope - normal * wp.dot(slope, normal)) * inverse
                        row[irradiance_at] = total
                    else:
                        row = rest_row()
                    ring_row(image, vertex, tangent, world, ring_start, ring, basis, shape_rows)
                    if shadowed != 0 and total > real(0.0):
                        by_shape = shape_rows[image, vertex]
                        for mode in range(modes_):
                            by_shape[mode] = by_shape[mode] + shadow_rates[image, mode + 1, vertex]
                        shape_rows[image, vertex] = by_shape
                    rest_rows[image, vertex] = row

    @wp.kernel(module=module)
    def unshade(
        world: wp.array2d(dtype=vec3),
        screen: wp.array2d(dtype=vec3),
        used: wp.array2d(dtype=wp.uint8),
        light: wp.array(dtype=rest_row),
        rotation: wp.array(dtype=mat33),
        intrinsics: wp.array(dtype=vec3),
        distance: real,
        width: int,
        ring_start: wp.array(dtype=wp.int32),
        ring: wp.array2d(dtype=wp.int32),
        shadowed: int,
        lobe_changes: wp.array2d(dtype=lobe_vector),
        chunk: int,
        normals: wp.array2d(dtype=vec3),
        inverse_lengths: wp.array2d(dtype=real),
        irradiances: wp.array2d(dtype=real),
        on_corner: wp.array2d(dtype=vec4),
        on_normal: wp.array2d(dtype=vec3),
        on_world: wp.array2d(dtype=vec3),
        on_light: wp.array2d(dtype=real),
        sums: wp.array2d(dtype=rest_row),
    ):
        """The way back: cotangents on the screen, irradiance and camera-frame normals of the vertices become
        those on world places (added to on_world) and on pose, light and framing (sums, one per chunk). With
        self-shadow on_light takes the cotangent on each vertex's irradiance."""
        image, part = wp.tid()
        shining = light[image]
        eye = eye_of(rotation[image], distance, intrinsics[image], width)
        back = wp.transpose(eye.rotation)
        total = rest_row()
        first = part * chunk
        for vertex in range(first, wp.min(first + chunk, used.shape[1])):
            if used[image, vertex] != wp.uint8(0):
                spot = screen[image, vertex]
                pulled = on_corner[image, vertex]
                pull = vec3(pulled[0], pulled[1], pulled[2])
                total = moved(total, eye, pull, spot)
                in_world = back * camera_cotangent(eye, spot, pull)
                normal = normals[image, vertex]
                by_normal = vec3()
                if irradiances[image, vertex] > real(0.0):
                    strength = pulled[3]
                    row = lobes(normal)
                    if shadowed != 0:
                        row = add_lobes(row, lobe_changes[image, vertex])
                        on_light[image, vertex] = strength
                    total = total + row * strength
                    by_normal = light_slope(shining, normal) * strength
                turning = on_normal[image, vertex]
                if turning[0] != real(0.0) or turning[1] != real(0.0):
                    pose = turned(eye, turning, eye.rotation * normal)
                    total[azimuth] = total[azimuth] + pose[0]
                    total[elevation] = total[elevation] + pose[1]
                    by_normal = by_normal + back * turning
                tangent = (by_normal - normal * wp.dot(by_normal, normal)) * inverse_lengths[image, vertex]
                ring_pull(image, vertex, tangent, in_world, world, ring_start, ring, on_world)
        sums[image, part] = total

    return SimpleNamespace(look=look, place=place, shade=shade, unshade=unshade, **vars(f))
