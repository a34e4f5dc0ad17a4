"""Triangle meshes and their normals."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from vig.io.checks import check_arrays, check_indices


@dataclass(frozen=True)
class Mesh:
    """A triangle mesh in metres.

    vertices: (V, 3) float32. faces: (F, 3) int32, counter-clockwise seen from outside.
    uv: (V, 2) float32 texture coordinates, or None.
    """

    vertices: np.ndarray
    faces: np.ndarray
    uv: np.ndarray | None = None

    def __post_init__(self) -> None:
        whole, floats = "int8 int16 int32 int64 uint8 uint16 uint32 uint64", "float16 float32 float64"
        kinds = {"vertices": (floats, ("V", 3)), "faces": (whole, ("F", 3)), "uv": (floats, ("V", 2))}
        arrays = {name: array for name, array in vars(self).items() if array is not None}
        check_arrays(arrays, {name: kinds[name] for name in arrays})
        check_indices("faces", self.faces, len(self.vertices))


def stack_meshes(meshes: Sequence[Any]) -> tuple[np.ndarray, np.ndarray]:
    """Return vertices (V, 3) and faces (F, 3) of meshes, or of anything that has these, as of one."""
    starts = np.cumsum([0] + [len(mesh.vertices) for mesh in meshes[:-1]])
    faces = [mesh.faces + start for mesh, start in zip(meshes, starts, strict=True)]
    return np.concatenate([mesh.vertices for mesh in meshes]), np.concatenate(faces)


def face_edges(faces: np.ndarray) -> np.ndarray:
    """Return the edges (3 F, 2) of faces (F, 3); an edge occurs once per face that has it."""
    return np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])


def face_normals(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Return outward normals of the faces, their length twice the face's area: (F, 3)."""
    a, b, c = (vertices.take(corner, axis=0) for corner in faces.T)
    (bx, by, bz), (cx, cy, cz) = (b - a).T, (c - a).T
    return np.stack([by * cz - bz * cy, bz * cx - bx * cz, bx * cy - by * cx], axis=1)


def vertex_normals(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Return unit vertex normals, the mean of the adjacent faces' weighted by area: (V, 3) float64.

    A vertex without area gets the zero vector.
    """
    weighted = face_normals(np.asarray(vertices, np.float64), faces)
    total = np.zeros((len(vertices), 3))
    for corner in range(3):
        for axis in range(3):
            total[:, axis] += np.bincount(faces[:, corner], weighted[:, axis], minlength=len(vertices))
    length = np.linalg.norm(total, axis=1, keepdims=True)
    return np.divide(total, length, out=np.zeros_like(total), where=length > 0)
