"""Meshes of one kind of thing from a folder, as people have them."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from vig.io.errors import UserError
from vig.io.progress import Meter
from vig.known_object.packs import SUFFIXES
from vig_world.assets.own.catalogue import mesh_folder, read_sources
from vig_world.assets.own.copies import COPY, shape_copies
from vig_world.assets.own.folder import fingerprint
from vig_world.assets.own.load import MeshPiece, load, mesh_files
from vig_world.assets.own.simplify import simplified
from vig_world.assets.source_meshes import MAX_FACES
from vig_world.mesh import face_normals, stack_meshes

_ONE_OF = f"one of {' '.join(SUFFIXES)}"


@dataclass(frozen=True, eq=False)
class Scan:
    """One file's triangles.

    Attributes:
        name: Path of the file, relative to its folder.
        vertices: (V, 3) float64, in the file's units and axes; equal ones are one.
        faces: (F, 3), each with an area.
        content_hash: Hash of the file's content.
        pieces: Parts with a material each, of few enough faces for training; none to ignore materials.
        notes: Sentences on omitted content of the file, and on substitutes for unread materials.
    """

    name: str
    vertices: np.ndarray
    faces: np.ndarray
    content_hash: str
    pieces: tuple[MeshPiece, ...] = ()
    notes: tuple[str, ...] = ()


def read_scans(
    meshes: str | Path, materials: bool = True, progress: bool = False
) -> tuple[list[Scan], dict[str, str]]:
    """Read every mesh below a folder, or of furniture catalogues, in the order of names; or a single file.

    Args:
        meshes: A folder, a file, or another argument of `mesh_folder`, such as `catalogue.sh3f:car`.
        materials: Whether their materials are kept.
        progress: Whether to report progress on standard error.

    Returns:
        The meshes, and why each other file was left out, by name.

    Raises:
        UserError: There is no such folder, or it holds no usable mesh.
    """
    folder = mesh_folder(meshes)
    scans: list[Scan] = []
    if folder.is_file():
        files, refused, folder = [(folder.name, folder)], {}, folder.parent
        if Path(files[0][0]).suffix.lower() not in SUFFIXES:
            raise UserError(f"expected a mesh, {_ONE_OF}; got '{meshes}'. Convert it.")
    else:
        files, others = mesh_files(folder)
        refused = read_sources(folder).left_out | dict.fromkeys(others, f"expected {_ONE_OF}; convert it")
    with Meter(len(files), 0, progress, "files") as meter:
        for name, path in files:
            try:
                loaded = load(folder, path)
                pieces = tuple(simplified(loaded.pieces, MAX_FACES)) if materials else ()
                welded, content = _weld(*stack_meshes(loaded.pieces)), fingerprint(loaded.files)
                scans.append(Scan(name, *welded, content, pieces, tuple(loaded.notes)))
            except UserError as error:
                refused[name] = str(error).removeprefix(f"{path}: ")
            meter.advance(1)
    for find_copies, what in (
        (copies_by_name, COPY),
        (same_shapes, "the same shape as {}, which counts once"),
    ):
        copies = find_copies(scans)
        for number, original in copies.items():
            refused[scans[number].name] = what.format(scans[original].name)
        scans = [scan for number, scan in enumerate(scans) if number not in copies]
    if not scans:
        first = next(iter(refused.items()))
        raise UserError(f"expected meshes in '{meshes}'; not one is usable. {first[0]}: {first[1]}")
    return scans, refused


def folder_of(meshes: str | Path) -> Path:
    """Return the folder of the meshes that `read_scans` reads, and of accompanying files."""
    path = mesh_folder(meshes)
    return path.parent if path.is_file() else path


def shape_invariants(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Return (5,) numbers of a surface that units, axes, place, mirroring and triangles' order leave alone.

    The ratios of the second moments about its principal axes, and of the higher moments of the distance from
    its centroid, weighted by area.
    """
    corners = vertices[faces]
    area = np.linalg.norm(face_normals(vertices, faces), axis=1)
    weight = np.repeat(area / area.sum() / 3, 3)
    middles = ((corners + np.roll(corners, 1, axis=1)) / 2).reshape(-1, 3)  # exact for second moments
    middles = middles - weight @ middles
    second = np.sort(np.linalg.eigvalsh((weight[:, None] * middles).T @ middles))
    distance = (middles**2).sum(1) / second.sum()
    higher = [float(weight @ distance**power) ** (1 / power) for power in (2, 3, 5)]
    return np.array([*(second[:2] / second[2]), *higher])


def copies_by_name(scans: list[Scan]) -> dict[int, int]:
    """Return the scans that repeat another at fewer faces or as a collision hull, by its number."""

    def alike(*pair: int) -> bool:
        one, other = (shape_invariants(scans[each].vertices, scans[each].faces) for each in pair)
        # Levels of mugs, down to a tenth of the faces, differ by up to .06, different cups by .003 to .7
        return bool(np.abs(one - other).max() < 0.1)

    names = [scan.name[: -len(Path(scan.name).suffix)] for scan in scans]
    return shape_copies(names, [len(scan.faces) for scan in scans], alike)


def same_shapes(scans: list[Scan]) -> dict[int, int]:
    """Return which scans show the surface of an earlier one, by its number: copies, other formats, units."""
    invariants = [shape_invariants(scan.vertices, scan.faces) for scan in scans]
    copies: dict[int, int] = {}
    for number, invariant in enumerate(invariants):
        for earlier in range(number):
            is_copy = np.abs(invariant - invariants[earlier]).max() < 3e-4  # of one surface
            if earlier not in copies and is_copy:
                copies[number] = earlier
                break
    return copies


def _weld(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Merge vertices at one place; leave out faces without area or given twice."""
    used = np.unique(faces)
    low, size = vertices[used].min(0), float(np.ptp(vertices[used], axis=0).max())
    if not size > 0:
        raise UserError("expected a mesh with an extent; all of its vertices are at one place.")
    unit = (vertices - low) / size
    _, representative, merged = np.unique(
        np.round(unit * 1e6).astype(np.int64), axis=0, return_index=True, return_inverse=True
    )
    corners = merged.ravel()[faces]
    points = unit[representative]
    spread = np.sqrt(np.linalg.eigvalsh(np.cov(points[np.unique(corners)].T)).clip(0))
    # A mesh narrower than a thousandth of its length is a line.
    if not spread[1] > 1e-3 * spread[2]:
        raise UserError("expected triangles with an area; all of them lie on a line.")
    area = np.linalg.norm(face_normals(points, corners), axis=1)
    _, first_of_face = np.unique(np.sort(corners, axis=1), axis=0, return_index=True)
    is_first = np.zeros(len(corners), bool)
    is_first[first_of_face] = True
    corners = corners[is_first & (area > 1e-14)]
    if not len(corners):
        raise UserError("expected triangles with an area; all of its are degenerate.")
    return points * size + low, corners
