"""The constant part of a moving mesh: its faces, and the edges between them."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import torch

from vig_native import engine
from vig_renderer.checks import check_table
from vig_renderer.edges import edges_of, weld_vertices


@dataclass(frozen=True)
class Topology:
    """Faces and edges of a triangle mesh, made once by `Topology.of`.

    faces (F, 3) int32: vertices. texture_faces (F, 3) int32: rows of the texture coordinates, `faces` itself
    where there is one pair of coordinates per vertex. edges (E, 6) int32: vertices a and b, the third vertex
    of the face on either side, and those two faces; -1 twice at a border. vertex_count: V. Raises ValueError
    for tables of other shapes or types, or with numbers out of range.
    """

    faces: torch.Tensor
    texture_faces: torch.Tensor
    edges: torch.Tensor
    vertex_count: int
    _mesh: tuple[tuple[object, ...], Any] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        self._copy()

    @property
    def mesh(self) -> Any:
        """Return the tables in the native library: a checked copy, renewed where torch knows of a write."""
        if self._mesh[0] != self._state():
            self._copy()
        return self._mesh[1]

    def _copy(self) -> None:
        if not isinstance(self.vertex_count, int) or not 0 <= self.vertex_count < 1 << 31:
            raise ValueError(f"vertex_count must be a whole number from 0 on; got {self.vertex_count}")
        check_table("faces", self.faces, (None, 3))
        check_table("texture_faces", self.texture_faces, (len(self.faces), 3))
        check_table("edges", self.edges, (None, 6))
        tables = (each.contiguous().numpy() for each in (self.faces, self.texture_faces, self.edges))
        object.__setattr__(self, "_mesh", (self._state(), engine.mesh(*tables, self.vertex_count)))

    def _state(self) -> tuple[object, ...]:
        tables = self.faces, self.texture_faces, self.edges
        versions = [0 if each.is_inference() else each._version for each in tables]
        return (*versions, *((each.data_ptr(), each.nbytes) for each in tables))

    def __reduce__(self) -> tuple[Any, ...]:
        return Topology, (self.faces, self.texture_faces, self.edges, self.vertex_count)

    @staticmethod
    def of(faces: np.ndarray, vertices: np.ndarray, texture_faces: np.ndarray | None = None) -> "Topology":
        """Find the edges of `faces` (F, 3).

        vertices (V, 3): current places; those at exactly the same place (a texture's seam) are one
        for the edges, so that no silhouette is found between them. An edge of three or more faces counts as
        a border of each. Faces that use a vertex twice have no edges.
        """
        faces, vertices = _rows("faces", faces), np.asarray(vertices)
        if vertices.ndim != 2 or vertices.shape[1] != 3:
            raise ValueError(f"vertices must be (V, 3); got {vertices.shape}")
        if len(faces) and (faces.min() < 0 or faces.max() >= len(vertices)):
            raise ValueError(
                f"faces must name vertices 0 to {len(vertices) - 1}; they name {faces.min()} to {faces.max()}"
            )
        if texture_faces is None:
            texture_faces = faces
        texture_faces = _rows("texture_faces", texture_faces)
        if texture_faces.shape != faces.shape:
            raise ValueError(f"texture_faces must be {faces.shape}, like faces; got {texture_faces.shape}")
        edges = edges_of(weld_vertices(vertices)[faces] if len(faces) else faces)
        return Topology(
            torch.from_numpy(faces.astype(np.int32, order="C")),
            torch.from_numpy(texture_faces.astype(np.int32, order="C")),
            torch.from_numpy(edges),
            len(vertices),
        )


def _rows(name: str, rows: np.ndarray) -> np.ndarray:
    """Return an array (F, 3) int64 of whole numbers; ValueError for anything else."""
    try:
        found = np.asarray(rows)
    except ValueError:  # rows of several lengths
        found = np.empty((0, 0), object)
    if found.size == 0 and found.dtype != object:
        found = np.zeros((0, 3), np.int64)
    if found.ndim != 2 or found.shape[1] != 3 or found.dtype.kind not in "iu":
        quads = " Cut quads into two triangles each." if found.ndim == 2 and found.shape[1] == 4 else ""
        raise ValueError(
            f"{name} must be triangles, (F, 3) whole numbers; got {found.shape} {found.dtype}.{quads}"
        )
    return found.astype(np.int64)
