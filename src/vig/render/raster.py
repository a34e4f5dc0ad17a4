"""Rasterisation: which triangle is seen at each pixel's centre, and where on it."""

import functools
from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
import torch
import warp as wp

from vig.render.device import initialise, scalar_type, warp_array
from vig.scene import Camera

NEAR = 0.01
"""Metres; a triangle with a corner nearer than this is not drawn."""

DEPTH_STEP = 1e-7
"""Metres; depths are compared as multiples of it."""

NOTHING = (1 << 63) - 1


@functools.cache
def raster_kernels(dtype: torch.dtype) -> SimpleNamespace:
    """The rasteriser's kernels for one scalar type, compiled at first use."""
    initialise()
    real = scalar_type(dtype)
    vec2, vec3 = wp.types.vector(2, real), wp.types.vector(3, real)
    module = f"vig_raster_{np.dtype(str(dtype).split('.')[1]).itemsize * 8}"
    near, per_step = real(NEAR), real(1.0 / DEPTH_STEP)

    @wp.kernel(module=module)
    def rasterize_faces(
        points: wp.array2d(dtype=vec3),
        faces: wp.array2d(dtype=wp.int32),
        intrinsics: wp.array(dtype=vec3),
        width: wp.int32,
        height: wp.int32,
        cull: wp.int32,
        keys: wp.array3d(dtype=wp.int64),
        facing: wp.array2d(dtype=wp.uint8),
    ):
        image, face = wp.tid()
        facing[image, face] = wp.uint8(0)
        a = points[image, faces[face, 0]]
        b = points[image, faces[face, 1]]
        c = points[image, faces[face, 2]]
        if wp.min(a[2], wp.min(b[2], c[2])) < near:
            return
        # Homogeneous edge functions: the ray through a pixel times these is minus the barycentric weight
        # of a corner, up to one common factor; their determinant is negative for a face turned to the eye.
        edge_a = wp.cross(b, c)
        edge_b = wp.cross(c, a)
        edge_c = wp.cross(a, b)
        volume = wp.dot(a, edge_a)
        if volume < real(0.0):
            facing[image, face] = wp.uint8(1)
        if volume == real(0.0) or (volume > real(0.0) and cull == 1):
            return
        sign = real(1.0)
        if volume < real(0.0):
            sign = real(-1.0)
        focal = intrinsics[image][0]
        centre = vec2(intrinsics[image][1], intrinsics[image][2])
        ua = vec2(a[0], a[1]) / a[2] * focal + centre
        ub = vec2(b[0], b[1]) / b[2] * focal + centre
        uc = vec2(c[0], c[1]) / c[2] * focal + centre
        half = real(0.5)
        low_x = wp.max(wp.min(ua[0], wp.min(ub[0], uc[0])) - half, real(0.0))
        low_y = wp.max(wp.min(ua[1], wp.min(ub[1], uc[1])) - half, real(0.0))
        high_x = wp.min(wp.max(ua[0], wp.max(ub[0], uc[0])) - half, real(width - 1))
        high_y = wp.min(wp.max(ua[1], wp.max(ub[1], uc[1])) - half, real(height - 1))
        if high_x < low_x or high_y < low_y:
            return
        x0 = int(wp.ceil(low_x))
        x1 = int(wp.floor(high_x))
        y0 = int(wp.ceil(low_y))
        y1 = int(wp.floor(high_y))
        step = real(1.0) / focal
        for y in range(y0, y1 + 1):
            ray_y = (real(y) + half - centre[1]) * step
            ray_x = (real(x0) + half - centre[0]) * step
            wa = sign * (edge_a[0] * ray_x + edge_a[1] * ray_y + edge_a[2])
            wb = sign * (edge_b[0] * ray_x + edge_b[1] * ray_y + edge_b[2])
            wc = sign * (edge_c[0] * ray_x + edge_c[1] * ray_y + edge_c[2])
            da = sign * edge_a[0] * step
            db = sign * edge_b[0] * step
            dc = sign * edge_c[0] * step
            for x in range(x0, x1 + 1):
                if wa >= real(0.0) and wb >= real(0.0) and wc >= real(0.0):
                    depth = sign * volume / (wa + wb + wc)
                    key = (wp.int64(depth * per_step) << wp.int64(32)) | wp.int64(face)
                    wp.atomic_min(keys, image, y, x, key)
                wa = wa + da
                wb = wb + db
                wc = wc + dc

    @wp.kernel(module=module)
    def resolve(
        points: wp.array2d(dtype=vec3),
        faces: wp.array2d(dtype=wp.int32),
        intrinsics: wp.array(dtype=vec3),
        keys: wp.array3d(dtype=wp.int64),
        seen: wp.array3d(dtype=wp.int32),
        barycentric: wp.array3d(dtype=vec3),
        depths: wp.array3d(dtype=real),
    ):
        image, y, x = wp.tid()
        key = keys[image, y, x]
        if key == wp.int64(NOTHING):
            seen[image, y, x] = -1
            barycentric[image, y, x] = vec3()
            depths[image, y, x] = real(wp.inf)
            return
        face = int(key & wp.int64(0xFFFFFFFF))
        a = points[image, faces[face, 0]]
        b = points[image, faces[face, 1]]
        c = points[image, faces[face, 2]]
        focal = intrinsics[image][0]
        ray = vec3(
            (real(x) + real(0.5) - intrinsics[image][1]) / focal,
            (real(y) + real(0.5) - intrinsics[image][2]) / focal,
            real(1.0),
        )
        # Moving the corners along the ray changes no weight; near the face they lose no digits.
        near_face = ray * a[2]
        pa = a - near_face
        pb = b - near_face
        pc = c - near_face
        weights = vec3(
            wp.dot(ray, wp.cross(pb, pc)), wp.dot(ray, wp.cross(pc, pa)), wp.dot(ray, wp.cross(pa, pb))
        )
        weights = weights / (weights[0] + weights[1] + weights[2])
        seen[image, y, x] = face
        barycentric[image, y, x] = weights
        depths[image, y, x] = wp.dot(weights, vec3(a[2], b[2], c[2]))

    return SimpleNamespace(rasterize_faces=rasterize_faces, resolve=resolve, vec3=vec3, real=real)


@dataclass(frozen=True)
class Fragments:
    """What is seen at each pixel's centre.

    face[y, x] = f means that face f is the nearest there; -1: nothing.
    barycentric[y, x] are the perspective-correct weights of that face's three corners (0 where nothing).
    depth[y, x] is the distance along the optical axis in metres (inf where nothing).
    """

    face: np.ndarray
    barycentric: np.ndarray
    depth: np.ndarray


def rasterize(
    vertices: np.ndarray,
    faces: np.ndarray,
    rotation: np.ndarray,
    translation: np.ndarray,
    camera: Camera,
    cull: bool = False,
) -> Fragments:
    """Rasterise one mesh on the CPU in float32.

    vertices (V, 3) world, metres; faces (F, 3); rotation (3, 3) and translation (3,) are camera_from_world;
    cull drops faces turned away (clockwise). Faces nearer than 1 cm to the eye's plane are not drawn.
    """
    kernels = raster_kernels(torch.float32)
    points = (np.asarray(vertices) @ np.asarray(rotation).T + np.asarray(translation)).astype(np.float32)
    points_wp = wp.from_numpy(np.ascontiguousarray(points)[None], dtype=kernels.vec3, device="cpu")
    faces_wp = wp.from_numpy(np.ascontiguousarray(faces, np.int32), dtype=wp.int32, device="cpu")
    intrinsics = wp.from_numpy(
        np.array([[camera.focal, camera.cx, camera.cy]], np.float32), dtype=kernels.vec3, device="cpu"
    )
    size = (1, camera.height, camera.width)
    keys = torch.full(size, NOTHING, dtype=torch.int64)
    keys_wp = warp_array(keys, wp.int64)
    facing = torch.empty((1, len(faces)), dtype=torch.uint8)
    face = torch.empty(size, dtype=torch.int32)
    barycentric = torch.empty((*size, 3))
    depth = torch.empty(size)
    wp.launch(
        kernels.rasterize_faces,
        dim=(1, len(faces)),
        inputs=[points_wp, faces_wp, intrinsics, camera.width, camera.height, int(cull), keys_wp],
        outputs=[warp_array(facing, wp.uint8)],
        device="cpu",
    )
    wp.launch(
        kernels.resolve,
        dim=size,
        inputs=[points_wp, faces_wp, intrinsics, keys_wp],
        outputs=[
            warp_array(face, wp.int32),
            warp_array(barycentric, kernels.vec3),
            warp_array(depth, kernels.real),
        ],
        device="cpu",
    )
    return Fragments(face[0].numpy(), barycentric[0].numpy(), depth[0].numpy())
