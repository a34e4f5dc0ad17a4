"""Loads mesh files as triangles with textures; every failure is a UserError.

Each format is read by a file of `meshes`, as libraries silently drop unknown content.
"""

import os
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from vig.io.checks import read_bytes
from vig.io.errors import UserError
from vig.known_object.packs import SUFFIXES
from vig_world.assets.own.counting import refuse_huge
from vig_world.assets.own.folder import files_of
from vig_world.assets.own.meshes.gltf import read_gltf
from vig_world.assets.own.meshes.obj import read_obj
from vig_world.assets.own.meshes.off import read_off
from vig_world.assets.own.meshes.ply import read_ply
from vig_world.assets.own.meshes.stl import read_stl
from vig_world.assets.own.siblings import MAX_BYTES, Siblings
from vig_world.assets.own.surfaces import SurfaceMesh, paint
from vig_world.mesh import stack_meshes

UNREAD = tuple(
    ".fbx .usd .usda .usdc .usdz .dae .3mf .amf .step .stp .iges .igs .brep .blend .max .ma .mb .c4d .3ds"
    " .3dm .x3d .wrl .vrml .abc .lwo .skp .dxf .dwg .vtk .vtp .x_t .x_b .sldprt .ipt .fcstd .ifc .pcd .zip"
    " .7z .rar .gz .tgz .tar .xz .bz2".split()
)
"""Suffixes of other formats of meshes, and of archives, which are named where they are passed over."""
PICTURES = (".png", ".jpg", ".jpeg", ".bmp", ".tga", ".tif", ".tiff", ".webp", ".gif")


@dataclass(frozen=True)
class MeshPiece:
    """Triangles with one texture.

    vertices (V, 3) float64 in the file's units and axes; faces (F, 3); uv (V, 2), (0, 0) at the texture's
    bottom left; texture (h, w, 3) float32 linear albedo; opacity below 1 where the file says glass.
    """

    vertices: np.ndarray
    faces: np.ndarray
    uv: np.ndarray
    texture: np.ndarray
    opacity: float = 1.0


@dataclass(frozen=True)
class Loaded:
    """Contents of a mesh file: pieces by material, and the bytes of all files read.

    `notes` are sentences without a full stop on omitted content and on substitutes for materials not read.
    """

    pieces: list[MeshPiece]
    files: dict[str, bytes]
    notes: list[str]


def has_one_colour(pieces: Sequence[MeshPiece]) -> bool:
    """Return whether a mesh has no more than one colour, as in formats without any."""
    return len(pieces) == 1 and pieces[0].texture.size == 3


def mesh_files(folder: str | Path) -> tuple[list[tuple[str, Path]], list[str]]:
    """Return names and paths of the meshes below a folder, and names of files in formats that are not read.

    The latter without those that lie beside a mesh of the same name. UserError as `files_of`.
    """
    listed = files_of(folder, SUFFIXES, also=UNREAD)
    meshes = [(name, path) for name, path in listed if path.suffix.lower() in SUFFIXES]
    stems = {os.path.splitext(name)[0] for name, _ in meshes}
    unread = [name for name, path in listed if path.suffix.lower() in UNREAD]
    return meshes, [name for name in unread if os.path.splitext(name)[0] not in stems]


def load(root: Path, path: Path, nodes: tuple[str, ...] = ()) -> Loaded:
    """Load a mesh file with the scene's transforms applied.

    Args:
        root: Folder outside which nothing is read.
        path: The mesh file.
        nodes: The only nodes of the scene to read; empty: all.

    Raises:
        UserError: For a file that is huge, unreadable, empty, or has no finite triangle.
    """
    try:
        refuse_huge(path)
        data = read_bytes(path, MAX_BYTES)
        siblings = Siblings(root, path)
        with warnings.catch_warnings(), np.errstate(all="ignore"):  # problems are reported by the caller
            warnings.simplefilter("ignore")
            meshes = _read_meshes(path, data, siblings, nodes)
            pieces = _join_pieces(path, meshes)
    except UserError:
        raise
    except MemoryError as error:
        raise UserError(f"{path}: expected a mesh that fits into memory; got a larger one.") from error
    except Exception as error:  # a loader may raise anything on a damaged file
        why = str(error) or type(error).__name__
        raise UserError(f"{path}: expected a readable mesh; got a damaged one ({why[:200]}).") from error
    if not pieces:
        raise UserError(f"{path}: expected triangles; got none.")
    if any(mesh.uv is None and mesh.surface and mesh.surface.picture is not None for mesh in meshes):
        siblings.note("faces without texture coordinates", "the mean colour of their picture")
    if max(piece.opacity for piece in pieces) == 0:
        siblings.note("all of its materials are wholly transparent", "opaque ones")
        pieces = [replace(piece, opacity=1.0) for piece in pieces]
    return Loaded(pieces, {path.name: data, **siblings.read}, sorted(set(siblings.notes)))


def _read_meshes(path: Path, data: bytes, siblings: Siblings, nodes: tuple[str, ...]) -> list[SurfaceMesh]:
    suffix = path.suffix.lower()
    if suffix in (".stl", ".off"):
        meshes = [SurfaceMesh(*(read_stl if suffix == ".stl" else read_off)(data))]
    elif suffix in (".obj", ".ply"):
        meshes = (read_obj if suffix == ".obj" else read_ply)(data, siblings)
    else:
        meshes = read_gltf(data, siblings, leave_out_copies=not nodes)
    if unknown := sorted(set(nodes) - {name for mesh in meshes for name in mesh.names}):
        names = " ".join(sorted({mesh.names[-1] for mesh in meshes if mesh.names}))
        raise UserError(f"{path}: expected nodes among {names[:300]}; got {' '.join(unknown)}.")
    return [mesh for mesh in meshes if not nodes or set(nodes) & set(mesh.names)]


def _join_pieces(path: Path, meshes: list[SurfaceMesh]) -> list[MeshPiece]:
    """Return all triangles, those of one texture together."""
    groups: dict[Any, list[MeshPiece]] = {}
    for mesh in meshes:
        points, faces = mesh.vertices, mesh.faces
        if not len(faces):
            continue
        if faces.min() < 0 or faces.max() >= len(points):
            raise UserError(f"{path}: expected faces between its {len(points)} vertices; got others.")
        if not np.isfinite(points[np.unique(faces)]).all():
            raise UserError(f"{path}: expected finite vertices; got NaN or infinite ones.")
        opacity = 1.0 if mesh.surface is None else mesh.surface.opacity
        for painted in paint(mesh):
            texture = painted[3]
            key = (texture.shape, texture.tobytes(), opacity)
            groups.setdefault(key, []).append(MeshPiece(*painted, opacity))
    return [_join(group) for group in groups.values()]


def _join(group: list[MeshPiece]) -> MeshPiece:
    uv = np.concatenate([piece.uv for piece in group])
    return MeshPiece(*stack_meshes(group), uv, group[0].texture, group[0].opacity)
