"""Rasterisation: which triangle is seen at each pixel's centre."""

from pathlib import Path
from typing import Any

import torch
import warp as wp

from vig_renderer.device import initialise, kernel_module, native_code, scalar_type
from vig_renderer.once import make_once

NEAR = 0.01
"""Metres; a triangle with a corner nearer than this is not drawn."""

FACE_BITS = 28
"""A pixel's key holds its face in the lower bits and how far it is above them: the least key is seen."""

FACE_MASK = (1 << FACE_BITS) - 1
NOTHING = (1 << 63) - 1
"""Key of a pixel that no face covers, larger than any other."""

KEYS_MARGIN = 8
"""Keys that must follow an image's last, as pixels are drawn eight at a time."""

PIXEL_BOX = Path(__file__).with_name("pixel_box.cc")
"""Native code that both rasterisers share, this one and the generator's."""

FARTHEST = 1 << (62 - FACE_BITS)
DEPTH_STEPS = 1 << 27
"""Steps of a key in one over depth, per 1 / metre: 4 nanometres at 0.7 m."""


@make_once
def native_draw_faces(dtype: torch.dtype) -> Any:
    """The rasteriser's loop, in C++ for the sake of its speed: see draw_faces.cc.

    It draws faces `first` to `end` of mesh (row of screen and facing) into image (row of keys).
    """
    initialise()
    real = scalar_type(dtype)
    vec3 = wp.types.vector(3, real)
    constants = {
        "SLACK": -4.0 * torch.finfo(dtype).eps,
        "DEPTH_STEPS": float(DEPTH_STEPS),
        "FARTHEST": FARTHEST,
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
    ): ...

    return draw_faces


@make_once
def rasterize_kernel(dtype: torch.dtype, module: str | None = None) -> Any:
    """The kernel that draws meshes of the same faces, an image each; compiled at first use.

    It reads the screen: (x, y, q) of each vertex, its pixel coordinates and one over its depth; q = 0 marks
    a vertex at or behind the eye, whose faces are not drawn.
    """
    initialise()
    vec3 = wp.types.vector(3, scalar_type(dtype))
    draw_faces = native_draw_faces(dtype)

    @wp.kernel(module=module or kernel_module("raster", dtype))
    def rasterize_faces(
        screen: wp.array2d(dtype=vec3),
        faces: wp.array2d(dtype=wp.int32),
        chunk: wp.int32,
        width: wp.int32,
        height: wp.int32,
        cull: wp.int32,
        keys: wp.array2d(dtype=wp.int64),
        facing: wp.array2d(dtype=wp.uint8),
    ):
        image, part = wp.tid()
        end = wp.min((part + 1) * chunk, faces.shape[0])
        draw_faces(image, image, part * chunk, end, screen, faces, width, height, cull, keys, facing)

    return rasterize_faces
