"""Rasterisation of one mesh in numpy: the face seen at each pixel's centre, where on it, how far away."""

from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
import torch
import warp as wp

from vig.io.checks import check_indices
from vig.scene import Camera
from vig_renderer.device import initialise, kernel_module, launch
from vig_renderer.once import make_once
from vig_renderer.raster import FACE_MASK, KEYS_MARGIN, NEAR, NOTHING, rasterize_kernel


@make_once
def _kernels() -> SimpleNamespace:
    """Kernels before and after the core's own, in float32; see `rasterize_kernel` for the screen."""
    initialise()
    real, vec3 = wp.float32, wp.vec3
    module = kernel_module("fragments", torch.float32)
    near = real(NEAR)
    face_mask = wp.int64(FACE_MASK)

    @wp.kernel(module=module)
    def to_screen(
        points: wp.array2d(dtype=vec3),
        intrinsics: wp.array(dtype=vec3),
        screen: wp.array2d(dtype=vec3),
    ):
        image, vertex = wp.tid()
        point = points[image, vertex]
        screen[image, vertex] = vec3()
        if point[2] > near:
            q = real(1.0) / point[2]
            scale = intrinsics[image][0] * q
            screen[image, vertex] = vec3(
                point[0] * scale + intrinsics[image][1], point[1] * scale + intrinsics[image][2], q
            )

    @wp.kernel(module=module)
    def resolve(
        screen: wp.array2d(dtype=vec3),
        faces: wp.array2d(dtype=wp.int32),
        keys: wp.array2d(dtype=wp.int64),
        width: wp.int32,
        seen: wp.array2d(dtype=wp.int32),
        barycentric: wp.array2d(dtype=vec3),
        depths: wp.array2d(dtype=real),
    ):
        image, pixel = wp.tid()
        key = keys[image, pixel]
        if key == wp.int64(NOTHING):
            seen[image, pixel] = -1
            barycentric[image, pixel] = vec3()
            depths[image, pixel] = real(wp.inf)
            return
        face = int(key & face_mask)
        a = screen[image, faces[face, 0]]
        b = screen[image, faces[face, 1]]
        c = screen[image, faces[face, 2]]
        y = pixel / width
        off_x = real(pixel - y * width) + real(0.5) - a[0]
        off_y = real(y) + real(0.5) - a[1]
        area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
        wb = ((c[1] - a[1]) * off_x + (a[0] - c[0]) * off_y) / area
        wc = ((a[1] - b[1]) * off_x + (b[0] - a[0]) * off_y) / area
        weights = vec3((real(1.0) - wb - wc) * a[2], wb * b[2], wc * c[2])
        q = weights[0] + weights[1] + weights[2]
        seen[image, pixel] = face
        barycentric[image, pixel] = weights / q
        depths[image, pixel] = real(1.0) / q

    return SimpleNamespace(to_screen=to_screen, resolve=resolve)


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

    Args:
        vertices: (V, 3) world, metres. Faces nearer than `NEAR` to the eye's plane are not drawn.
        faces: (F, 3) whole numbers.
        rotation: (3, 3) camera_from_world.
        translation: (3,) camera_from_world, metres.
        camera: Its intrinsics.
        cull: Leave out faces turned away (clockwise).
    """
    vertices, faces = _checked("vertices", vertices, "V, 3"), _checked("faces", faces, "F, 3", "iu")
    rotation, translation = _checked("rotation", rotation, "3, 3"), _checked("translation", translation, "3")
    if len(faces) > FACE_MASK:
        raise ValueError(f"faces must be at most {FACE_MASK}; got {len(faces)}. Pass fewer.")
    if not isinstance(camera, Camera):
        raise ValueError(f"camera must be a Camera; got a {type(camera).__name__}. Pass a vig.Camera.")
    try:
        check_indices("faces", faces, len(vertices))
    except ValueError as error:
        raise ValueError(f"{error}. Pass the faces of these vertices.") from None
    kernels = _kernels()
    points = torch.from_numpy((vertices @ rotation.T + translation).astype(np.float32))[None]
    corners = torch.from_numpy(np.ascontiguousarray(faces, np.int32))
    intrinsics = torch.tensor([[camera.focal, camera.cx, camera.cy]], dtype=torch.float32)
    width, size = camera.width, camera.height * camera.width
    screen = torch.empty_like(points)
    keys = torch.full((1, size + KEYS_MARGIN), NOTHING)
    facing = torch.empty((1, len(faces)), dtype=torch.uint8)
    face, depth = torch.empty((1, size), dtype=torch.int32), torch.empty((1, size))
    barycentric = torch.empty((1, size, 3))
    launch(kernels.to_screen, (1, len(vertices)), points, intrinsics, screen)
    drawn = screen, corners, len(faces), width, camera.height, int(cull), keys, facing
    launch(rasterize_kernel(torch.float32), (1, 1), *drawn)
    launch(kernels.resolve, (1, size), screen, corners, keys, width, face, barycentric, depth)
    shape = camera.height, camera.width
    return Fragments(face.view(shape).numpy(), barycentric.view(*shape, 3).numpy(), depth.view(shape).numpy())


def _checked(name: str, values: np.ndarray, shape: str, kinds: str = "fiu") -> np.ndarray:
    """Check an array against a shape such as "V, 3", in which a letter is any number. Raises ValueError."""
    array = np.asarray(values)
    sizes = shape.split(", ")
    fits = array.ndim == len(sizes) and all(
        size.isalpha() or int(size) == held for size, held in zip(sizes, array.shape, strict=True)
    )
    if not fits or array.dtype.kind not in kinds:
        numbers = "numbers" if "f" in kinds else "whole numbers"
        raise ValueError(
            f"{name} must be ({shape}) {numbers}; got {array.shape} {array.dtype}. Pass an array."
        )
    return array
