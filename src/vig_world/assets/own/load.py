"""Loads mesh files as triangles with textures; every failure is a UserError.

Each format is first made plain, or read, by a file of `meshes`, as trimesh drops in silence what it does not
know; scenes, materials and textures of glTF and OBJ are then trimesh's.
"""

from __future__ import annotations

import io
import logging
import os
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
from PIL import Image

from vig.io.checks import read_bytes
from vig.io.errors import UserError
from vig_world.assets.own.counting import MOST_BYTES, refuse_huge
from vig_world.assets.own.folder import files_of
from vig_world.assets.own.meshes import plain_gltf, plain_obj, read_off, read_ply, read_stl
from vig_world.assets.own.surfaces import MOST_PIXELS, opacity_of, painted

SUFFIXES = (".glb", ".gltf", ".obj", ".ply", ".off", ".stl")
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
    """What a mesh file holds: pieces by material, the bytes of all files read, and names not found.

    `notes` are sentences without a full stop: what was left out.
    """

    pieces: list[MeshPiece]
    files: dict[str, bytes]
    missing: list[str]
    notes: list[str] = field(default_factory=list)


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
        data = read_bytes(path, MOST_BYTES)
        files, notes = _files(root, path), list[str]()
        with _quiet():
            suffix = path.suffix.lower()
            scene = _scene(suffix, data, files, None if nodes else notes.append)
            pieces = _pieces(path, scene, nodes, suffix in (".glb", ".gltf"))
    except UserError:
        raise
    except MemoryError as error:
        raise UserError(f"{path}: expected a mesh that fits into memory; got a larger one.") from error
    except Exception as error:  # a loader may raise anything on a damaged file
        why = str(error) or type(error).__name__
        raise UserError(f"{path}: expected a readable mesh; got a damaged one ({why[:200]}).") from error
    if not pieces:
        raise UserError(f"{path}: expected triangles; got none.")
    missing = files.missing + [name for name, read in files.read.items() if not _readable(name, read)]
    return Loaded(pieces, {path.name: data, **files.read}, sorted(set(missing)), notes)


def _scene(suffix: str, data: bytes, files: Any, note: Callable[[str], None] | None) -> Any:
    """A file's scene as trimesh has it."""
    import trimesh  # takes half a second, so only when custom meshes are read

    if suffix in (".glb", ".gltf", ".obj"):
        plain = plain_obj(data) if suffix == ".obj" else plain_gltf(data, files.get, note)
        kind = "obj" if suffix == ".obj" else "glb"
        return trimesh.load_scene(io.BytesIO(plain), file_type=kind, resolver=files, process=False)
    colours: dict[str, Any] = {}
    if suffix == ".stl":
        vertices, faces = read_stl(data)
    elif suffix == ".off":
        vertices, faces = read_off(data)
    else:
        ply = read_ply(data)
        vertices, faces = ply.vertices, ply.faces
        colours = {"vertex_colors": ply.vertex_colours, "face_colors": ply.face_colours}
    if faces.size == 0:
        return trimesh.Scene()
    return trimesh.Scene(trimesh.Trimesh(vertices, faces, process=False, **colours))


def _files(root: Path, path: Path) -> Any:
    """A resolver of trimesh's that reads below `root` only and keeps what it read and what was missing."""
    from trimesh.resolvers import FilePathResolver

    top, folder = os.path.realpath(root), os.path.realpath(path.parent)

    class Files(FilePathResolver):
        def __init__(self) -> None:
            super().__init__(folder)
            self.read: dict[str, bytes] = {}
            self.missing: list[str] = []

        def get(self, name: str) -> bytes:
            plain = name.strip().replace("\\", "/")
            for candidate in (plain, unquote(plain), plain.lstrip("/"), plain.split("/")[-1]):
                place = os.path.realpath(os.path.join(folder, candidate))
                if os.path.commonpath([top, place]) == top and os.path.isfile(place):
                    data = read_bytes(place, MOST_BYTES)
                    if not plain.lower().endswith(PICTURES) or _opens(data):
                        self.read[plain] = data
                        return data
                    break
            self.missing.append(plain)
            raise FileNotFoundError(name)

    return Files()


@contextmanager
def _quiet() -> Iterator[None]:
    """Silence log lines and warnings of trimesh and pillow: problems are reported by the caller."""
    logger = logging.getLogger("trimesh")
    was_disabled, logger.disabled = logger.disabled, True
    try:
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            yield
    finally:
        logger.disabled = was_disabled


def _opens(data: bytes) -> bool:
    """Whether a picture's header is one of a size that is decoded."""
    try:
        with Image.open(io.BytesIO(data)) as image:
            return image.width * image.height <= MOST_PIXELS
    except Exception:  # a decoder may raise anything on a damaged file
        return False


def _readable(name: str, data: bytes) -> bool:
    if not name.lower().endswith(PICTURES):
        return True
    try:
        with Image.open(io.BytesIO(data)) as image:
            image.load()
        return True
    except Exception:  # a decoder may raise anything on a damaged file
        return False


def _pieces(path: Path, scene: Any, nodes: tuple[str, ...], gltf: bool) -> list[MeshPiece]:
    """The scene's triangles in its own frame, those of one texture together."""
    names = sorted(scene.graph.nodes_geometry)
    unknown = sorted(set(nodes) - set(scene.graph.nodes))
    if unknown:
        raise UserError(f"{path}: expected nodes among {' '.join(names)[:300]}; got {' '.join(unknown)}.")
    groups: dict[Any, list[MeshPiece]] = {}
    for node in names:
        transform, geometry_name = scene.graph[node]
        if nodes and not any(node in (name, *scene.graph.transforms.successors(name)) for name in nodes):
            continue
        geometry = scene.geometry[geometry_name]
        if not hasattr(geometry, "faces") or not len(geometry.faces):
            continue
        points, faces = np.asarray(geometry.vertices, np.float64), np.asarray(geometry.faces, np.int64)
        if faces.min() < 0 or faces.max() >= len(points):
            raise UserError(f"{path}: expected faces between its {len(points)} vertices; got others.")
        if not np.isfinite(points[np.unique(faces)]).all():
            raise UserError(f"{path}: expected finite vertices; got NaN or infinite ones.")
        if np.linalg.det(transform[:3, :3]) < 0:
            faces = faces[:, ::-1]
        points = points @ transform[:3, :3].T + transform[:3, 3]
        points, faces, uv, texture = painted(points, faces, geometry.visual, gltf)
        opacity = opacity_of(geometry.visual, gltf)
        key = (texture.shape, texture.tobytes(), opacity)
        groups.setdefault(key, []).append(MeshPiece(points, faces, uv, texture, opacity))
    return [_joined(group) for group in groups.values()]


def _joined(group: list[MeshPiece]) -> MeshPiece:
    starts = np.cumsum([0] + [len(piece.vertices) for piece in group[:-1]])
    faces = [piece.faces + start for piece, start in zip(group, starts, strict=True)]
    vertices, uv = (np.concatenate([getattr(p, key) for p in group]) for key in ("vertices", "uv"))
    return MeshPiece(vertices, np.concatenate(faces), uv, group[0].texture, group[0].opacity)
