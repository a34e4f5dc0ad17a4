"""The user's own meshes of a class, with their materials, in the class's frame."""

import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path

import numpy as np
from scipy.sparse import csr_matrix
from scipy.spatial import cKDTree

from vig.io.checks import check_indices, decode, read_tensors, reading
from vig.io.files import write_arrays
from vig.scene import ObjectClass
from vig_world.assets.own.load import MeshPiece
from vig_world.assets.own.simplify import simplified
from vig_world.mesh import face_normals

FILE = "meshes.safetensors"  # name of the file in a pack's build folder
MAX_FACES = 20_000  # most faces of a mesh; one with more is simplified
NEIGHBOURS = 4  # vertices of the template by which a vertex of a mesh is moved


@dataclass(frozen=True, eq=False)
class SourceMesh:
    """A mesh as its file has it, in the class's frame.

    Attributes:
        vertices: (V, 3) float32, metres.
        faces: (F, 3) int32.
        uv: (V, 2) float32.
        material: (F,) int32, into textures.
        textures: (h, w, 3) float32 linear albedo each.
        opacity: Opacity of each texture; below 1 for glass.
        registered: (T, 3) float32, the class's template as it lies on the mesh.
        design: Number of the pack's design that was made from it, -1 for a mesh that was refused.
        split: The only split that shows it.
    """

    vertices: np.ndarray
    faces: np.ndarray
    uv: np.ndarray
    material: np.ndarray
    textures: tuple[np.ndarray, ...]
    opacity: tuple[float, ...]
    registered: np.ndarray
    design: int
    split: str

    @cached_property
    def normals(self) -> np.ndarray:
        """Return unit normals (F, 3, 3) of the faces' corners; see `corner_normals`."""
        return corner_normals(self.vertices, self.faces).astype(np.float32)

    @cached_property
    def _neighbours(self) -> tuple[np.ndarray, np.ndarray]:
        """Return vertices (V, NEIGHBOURS) of the template near each vertex, and weights that add up to 1."""
        distance, index = cKDTree(self.registered).query(self.vertices, NEIGHBOURS)
        weight = 1 / (distance + 1e-3 * np.ptp(self.registered, axis=0).max()) ** 2
        return index, (weight / weight.sum(1, keepdims=True)).astype(np.float32)

    def follow_template(self, template: np.ndarray) -> np.ndarray:
        """Return vertices (V, 3) as the template moves from its place on the mesh to `template` (T, 3)."""
        index, weight = self._neighbours
        move = (template - self.registered).astype(np.float32)
        return self.vertices + np.einsum("vk,vkd->vd", weight, move[index])

    @staticmethod
    def of(
        pieces: Sequence[MeshPiece],
        linear: np.ndarray,
        offset: np.ndarray,
        registered: np.ndarray,
        design: int,
        split: str,
    ) -> "SourceMesh":
        """Return the mesh of a file's pieces, moved by a linear map (3, 3) and an offset (3,)."""
        pieces = simplified(list(pieces), MAX_FACES)
        starts = np.cumsum([0] + [len(piece.vertices) for piece in pieces])
        return SourceMesh(
            np.concatenate([p.vertices @ linear.T + offset for p in pieces]).astype(np.float32),
            np.concatenate([p.faces + s for p, s in zip(pieces, starts, strict=False)]).astype(np.int32),
            np.concatenate([p.uv for p in pieces]).astype(np.float32),
            np.repeat(np.arange(len(pieces)), [len(p.faces) for p in pieces]).astype(np.int32),
            tuple(piece.texture for piece in pieces),
            tuple(piece.opacity for piece in pieces),
            registered.astype(np.float32),
            design,
            split,
        )


def corner_normals(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Return unit normals (F, 3, 3) of the faces' corners, smooth but across creases, whatever the winding.

    The mean of the normals, weighted by area, of all faces at a corner that meet the corner's own face at
    less than the crease angle; a face that is wound the other way counts with its normal turned round.
    """
    _, place = np.unique(
        np.round(vertices / np.ptp(vertices, axis=0).max() * 1e5).astype(np.int64),
        axis=0,
        return_inverse=True,
    )
    own = face_normals(vertices.astype(np.float64), faces)
    unit = own / np.maximum(np.linalg.norm(own, axis=1, keepdims=True), 1e-300)
    corner = place.ravel()[faces].ravel()
    count = len(corner)
    incidence = csr_matrix((np.ones(count), (np.arange(count), corner)), (count, int(corner.max()) + 1))
    pairs = (incidence @ incidence.T).tocoo()
    mine, other = pairs.row // 3, pairs.col // 3
    cosine = np.einsum("nk,nk->n", unit[mine], unit[other])
    # Faces that meet at a sharper angle, 40 degrees, keep an edge in their shading
    smooth = np.abs(cosine) > 0.77
    weight = np.sign(cosine[smooth])
    sums = csr_matrix((weight, (pairs.row[smooth], other[smooth])), (count, len(faces))) @ own
    length = np.linalg.norm(sums, axis=1, keepdims=True)
    return np.where(length > 0, sums / np.maximum(length, 1e-300), np.repeat(unit, 3, axis=0)).reshape(
        -1, 3, 3
    )


def save(path: Path, meshes: Sequence[SourceMesh]) -> None:
    """Write meshes."""
    tensors: dict[str, np.ndarray] = {}
    for number, mesh in enumerate(meshes):
        for name in _ARRAYS:
            tensors[f"{number}.{name}"] = getattr(mesh, name)
        tensors[f"{number}.opacity"] = np.array(mesh.opacity, np.float32)
        for index, texture in enumerate(mesh.textures):
            tensors[f"{number}.texture.{index}"] = np.ascontiguousarray(texture, np.float16)
    metadata = {"meshes": json.dumps([[mesh.design, mesh.split] for mesh in meshes])}
    write_arrays(path, tensors, metadata)


def meshes_fingerprint(pack: Path) -> str:
    """Return a short hash of the meshes of a pack, "" where it has none."""
    path = pack / "build" / FILE
    return hashlib.sha256(path.read_bytes()).hexdigest()[:16] if path.exists() else ""


_ARRAYS = ("vertices", "faces", "uv", "material", "registered")


@lru_cache(maxsize=4)
def source_meshes_of(object_class: ObjectClass) -> tuple[SourceMesh, ...]:
    """Read the meshes of a pack; none where it has none.

    Raises:
        UserError: They are damaged.
    """
    path = None if object_class.folder is None else object_class.folder / "build" / FILE
    if path is None or not path.exists():
        return ()
    meshes = []
    with reading(path, "the meshes of a class", "Build it again."):
        tensors, metadata = read_tensors(path)
        described = decode(list[tuple[int, str]], json.loads(metadata["meshes"]))
        for number, (design, split) in enumerate(described):
            own = {n.split(".", 1)[1]: v for n, v in tensors.items() if n.startswith(f"{number}.")}
            check_indices("faces", own["faces"], len(own["vertices"]))
            count = len(own["opacity"])
            check_indices("material", own["material"], count)
            textures = tuple(own[f"texture.{index}"].astype(np.float32) for index in range(count))
            vertices, faces, uv, material, registered = (own[name] for name in _ARRAYS)
            opacity = tuple(own["opacity"].tolist())
            loaded = vertices, faces, uv, material, textures, opacity, registered, design, split
            meshes.append(SourceMesh(*loaded))
    return tuple(meshes)
