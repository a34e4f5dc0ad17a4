"""Rasterisation of one mesh in numpy: the face seen at each pixel's centre, where on it, how far away."""

from dataclasses import dataclass

import numpy as np

from vig.io.checks import check_indices
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
    vertices, faces = _check_array("vertices", vertices, "V, 3"), _check_array("faces", faces, "F, 3", "iu")
    rotation, translation = (
        _check_array("rotation", rotation, "3, 3"),
        _check_array("translation", translation, "3"),
    )
    if not isinstance(camera, Camera):
        raise ValueError(f"camera must be a Camera; got a {type(camera).__name__}. Pass a vig.Camera.")
    try:
        check_indices("faces", faces, len(vertices))
    except ValueError as error:
        raise ValueError(f"{error}. Pass the faces of these vertices.") from None
    points = (vertices @ rotation.T + translation).astype(np.float32)
    eye = camera.focal, camera.cx, camera.cy, camera.width, camera.height
    return Fragments(*engine.rasterize(points, faces.astype(np.int32), eye, NEAR, cull))


def _check_array(name: str, values: np.ndarray, shape: str, kinds: str = "fiu") -> np.ndarray:
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
