"""Rasterisation of one mesh in numpy: the face seen at each pixel's centre, where on it, how far away."""

from dataclasses import dataclass

import numpy as np

from vig.io.checks import check_arrays, check_indices
from vig.scene import Camera
from vig_native import engine
from vig_renderer import NEAR


@dataclass(frozen=True)
class Fragments:
    """The visible face at each pixel's centre.

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
        vertices: (V, 3) world, metres. Faces nearer than `NEAR` to the camera's plane are not drawn.
        faces: (F, 3) whole numbers.
        rotation: (3, 3) camera_from_world.
        translation: (3,) camera_from_world, metres.
        camera: Its intrinsics.
        cull: Leave out faces turned away (clockwise).
    """
    arrays = {"vertices": vertices, "faces": faces, "rotation": rotation, "translation": translation}
    arrays = {name: np.asarray(array) for name, array in arrays.items()}
    whole = "int32 int64 uint32"
    numbers = f"float32 float64 {whole}"
    check_arrays(
        arrays,
        {"vertices": (numbers, ("V", 3)), "faces": (whole, ("F", 3)), "rotation": (numbers, (3, 3)),
         "translation": (numbers, (3,))},
    )  # fmt: skip
    vertices, faces, rotation, translation = arrays.values()
    if not isinstance(camera, Camera):
        raise ValueError(f"camera must be a Camera; got a {type(camera).__name__}. Pass a vig.Camera.")
    try:
        check_indices("faces", faces, len(vertices))
    except ValueError as error:
        raise ValueError(f"{error}. Pass the faces of these vertices.") from None
    points = (vertices @ rotation.T + translation).astype(np.float32)
    eye = camera.focal, camera.cx, camera.cy, camera.width, camera.height
    return Fragments(*engine.rasterize(points, faces.astype(np.int32), eye, NEAR, cull))
