"""Rasterisation: which triangle is seen at each pixel's centre, and where on it."""

import functools
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import torch
import warp as wp

from vig.checks import check_indices
from vig.renderer.device import initialise, launch, native_code, scalar_type
from vig.scene import Camera

NEAR = 0.01
"""Metres; a triangle with a corner nearer than this is not drawn."""

FACE_BITS = 28
"""A pixel's key holds its face in the lower bits and how far it is above them: the least key is seen."""

FACE_MASK = (1 << FACE_BITS) - 1
NOTHING = (1 << 63) - 1

KEYS_MARGIN = 8
"""Keys that must follow an image's last, as pixels are drawn eight at a time."""

PIXEL_BOX = Path(__file__).with_name("pixel_box.cc")
"""Native code that both rasterisers share, this one and the generator's."""

_FARTHEST = 1 << (62 - FACE_BITS)
_DEPTH_STEPS = 1 << 27
"""Steps of a key in one over depth, per 1 / metre: 4 nanometres at 0.7 m."""


@functools.cache
def native_draw_faces(dtype: torch.dtype) -> Any:
    """The rasteriser's loop, in C++ for the sake of its speed: see draw_faces.cc.

    It draws faces `first` to `end` of mesh (row of screen, facing and used) into image (row of keys).
    """
    initialise()
    real = scalar_type(dtype)
    vec3 = wp.types.vector(3, real)
    constants = {
        "SLACK": -4.0 * torch.finfo(dtype).eps,
        "DEPTH_STEPS": float(_DEPTH_STEPS),
        "FARTHEST": _FARTHEST,
        "FACE_BITS": FACE_BITS,
    }

    @wp.func_native(
        snippet=native_code(Path(__file__).parent, PIXEL_BOX.name, "draw_faces.cc", real=real, **constants)
    )
    def draw_faces(
        mesh: wp.int32,
        image: wp.int32,
        first: wp.int32,
        end: wp.int32,
        screen: wp.array2d(dtype=vec3),
        faces: wp.array2d(dtype=wp.int32),
        width: wp.int32,
        height: wp.int32,
        cull: wp.int32,
        keys: wp.array2d(dtype=wp.int64),
        facing: wp.array2d(dtype=wp.uint8),
        used: wp.array2d(dtype=wp.uint8),
    ): ...

    return draw_faces


@functools.cache
def raster_kernels(dtype: torch.dtype) -> SimpleNamespace:
    """The rasteriser's kernels for one scalar type, compiled at first use.

    They read the screen: (x, y, q) of each vertex, its pixel coordinates and one over its depth; q = 0 marks
    a vertex at or behind the eye, whose faces are not drawn.
    """
    initialise()
    real = scalar_type(dtype)
    vec3 = wp.types.vector(3, real)
    module = f"vig_raster_{np.dtype(str(dtype).split('.')[1]).itemsize * 8}"
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

    draw_faces = native_draw_faces(dtype)

    @wp.kernel(module=module)
    def rasterize_faces(
        screen: wp.array2d(dtype=vec3),
        faces: wp.array2d(dtype=wp.int32),
        chunk: wp.int32,
        width: wp.int32,
        height: wp.int32,
        cull: wp.int32,
        keys: wp.array2d(dtype=wp.int64),
        facing: wp.array2d(dtype=wp.uint8),
        used: wp.array2d(dtype=wp.uint8),
    ):
        image, part = wp.tid()
        end = wp.min((part + 1) * chunk, faces.shape[0])
        draw_faces(image, image, part * chunk, end, screen, faces, width, height, cull, keys, facing, used)

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

    return SimpleNamespace(to_screen=to_screen, rasterize_faces=rasterize_faces, resolve=resolve)


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
    kernels = raster_kernels(torch.float32)
    points = torch.from_numpy((vertices @ rotation.T + translation).astype(np.float32))[None]
    corners = torch.from_numpy(np.ascontiguousarray(faces, np.int32))
    intrinsics = torch.tensor([[camera.focal, camera.cx, camera.cy]], dtype=torch.float32)
    width, size = camera.width, camera.height * camera.width
    screen = torch.empty_like(points)
    keys = torch.full((1, size + KEYS_MARGIN), NOTHING)
    flags = [torch.empty((1, number), dtype=torch.uint8) for number in (len(faces), len(vertices))]
    face, depth = torch.empty((1, size), dtype=torch.int32), torch.empty((1, size))
    barycentric = torch.empty((1, size, 3))
    launch(kernels.to_screen, (1, len(vertices)), points, intrinsics, screen)
    drawn = screen, corners, len(faces), width, camera.height, int(cull), keys, *flags
    launch(kernels.rasterize_faces, (1, 1), *drawn)
    launch(kernels.resolve, (1, size), screen, corners, keys, width, face, barycentric, depth)
    shape = camera.height, camera.width
    return Fragments(face.view(shape).numpy(), barycentric.view(*shape, 3).numpy(), depth.view(shape).numpy())


def _checked(name: str, given: np.ndarray, shape: str, kinds: str = "fiu") -> np.ndarray:
    """Check an array against a shape such as "V, 3", in which a letter is any number. Raises ValueError."""
    array = np.asarray(given)
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
