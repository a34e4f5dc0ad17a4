"""A class of exact shape from one mesh file, as `vig fit --mesh` needs it."""

import shutil
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

from vig.io.errors import UserError
from vig.known_object import Surface
from vig.known_object.packs import SUFFIXES
from vig.scene import ObjectClass, Symmetry
from vig.scene.object_class import axis_name
from vig_train.building.build import build_class
from vig_train.building.settings import BuildSettings, axis_vector, fills_unit_cube
from vig_world.asset_cache import asset_cache
from vig_world.assets.own.folder import fingerprint
from vig_world.assets.own.load import MeshPiece, load
from vig_world.assets.own.simplify import simplified

MAX_FACES = 10_000
"""Faces of the surface that poses are searched with, at most; with 3,000 depths were off by 2 %."""
TURNS = {
    Symmetry.NONE: "no turn about its vertical looks the same",
    Symmetry.HALF_TURN: "half a turn about its vertical looks the same",
    Symmetry.ANY_TURN: "any turn about its vertical looks the same, so that none is sought",
}


def pack_of_mesh(
    mesh: Path,
    length: float | None = None,
    say: Callable[[str], None] = lambda line: None,
    up: str | None = None,
) -> Path:
    """Return the class pack of a mesh file, without a recognizer; made at most once for each content.

    It lies in the user's cache folder; where nothing can be written there, in one that is made anew.

    Args:
        mesh: The file.
        length: The object's longest side, metres, where the file is not in metres.
        say: Called with a line before each step that takes time, and for each assumption.
        up: The axis of the file that points up in the photos, such as "z" or "-x"; None: estimated.

    Raises:
        UserError: It is no mesh that can be used.
    """
    mesh = Path(mesh)
    if not mesh.is_file() or mesh.suffix.lower() not in SUFFIXES:
        came = "a folder" if mesh.is_dir() else "no such file" if not mesh.exists() else f"'{mesh.name}'"
        raise UserError(f"expected --mesh FILE, one of {' '.join(SUFFIXES)}; got {came}. Check the path.")
    name = "".join(letter if letter.isprintable() else "_" for letter in mesh.stem)
    settings = BuildSettings(name[:100], up=up, length=length, materials=False)
    settings.check()
    loaded = load(mesh.parent, mesh)
    key = f"{fingerprint(loaded.files)[:24]}-6"  # edition of the packs: others are not used
    key += ("" if length is None else f"-{length:g}m") + ("" if up is None else axis_name(axis_vector(up)))
    cache = asset_cache().folder
    try:
        if cache is None:
            raise PermissionError("no folder can be made")
        pack = _make_pack(mesh, loaded.pieces, settings, cache / "meshes" / f"{name[:40]}-{key}", say)
    except (OSError, UserError) as error:
        reason = error if isinstance(error, OSError) else error.__cause__
        if not isinstance(reason, OSError):
            raise
        say(f"the cache cannot be used ({reason}): '{mesh.name}' is made ready for this run alone")
        try:
            pack = _make_pack(
                mesh, loaded.pieces, settings, Path(tempfile.mkdtemp(prefix="vig-mesh-")) / key, say
            )
        except OSError as failure:
            raise UserError(f"expected a folder for '{mesh.name}' that can be written; {failure}.") from None
    object_class = ObjectClass.load(pack)
    own = float(np.ptp(np.concatenate([piece.vertices for piece in loaded.pieces]), axis=0).max())
    say(f"'{mesh.name}': {TURNS[object_class.symmetry]}; {_size(mesh, own, length, object_class)}")
    if up is None:
        assert object_class.object_from_mesh is not None
        axis = axis_name(object_class.object_from_mesh[2, :3])
        gltf = " (not glTF's +y)" if _is_gltf(mesh) and axis != "+y" else ""
        say(f"'{mesh.name}': its {axis} axis{gltf} is taken as up; --up states another")
    return pack


def _make_pack(
    mesh: Path, pieces: list[MeshPiece], settings: BuildSettings, pack: Path, say: Callable[[str], None]
) -> Path:
    """Return the pack's folder, which is filled where it is not there."""
    if (pack / "class.json").is_file():
        return pack
    pack.parent.mkdir(parents=True, exist_ok=True)
    making = Path(tempfile.mkdtemp(prefix="making-", dir=pack.parent))
    say(f"'{mesh.name}' is made ready: some 15 seconds, a minute on a busy machine")
    try:
        build_class(mesh, making / "pack", settings, lambda line: None)
        object_from_mesh = ObjectClass.load(making / "pack").object_from_mesh
        if object_from_mesh is not None:
            Surface.of(simplified(pieces, MAX_FACES), object_from_mesh).save(making / "pack")
        try:
            (making / "pack").rename(pack)
        except OSError:  # another process was faster
            if not (pack / "class.json").is_file():
                raise
    finally:
        shutil.rmtree(making, ignore_errors=True)
    return pack


def _is_gltf(mesh: Path) -> bool:
    return mesh.suffix.lower() in (".glb", ".gltf")


def _size(mesh: Path, own: float, length: float | None, object_class: ObjectClass) -> str:
    """Return the size that was taken of a file whose longest side is `own`, and where it comes from."""
    taken = float(np.ptp(object_class.shape_model.mean, axis=0).max())
    if length is not None and _is_gltf(mesh) and abs(length / own - 1) > 0.01:
        return f"its longest side is {length:.3g} m as --length states, in place of the file's {own:.3g} m"
    if object_class.size_known:
        return f"its longest side is {taken:.3g} m"
    if not _is_gltf(mesh):
        size = f"its longest side is {taken:.3g} m for want of a unit"
    elif fills_unit_cube(own):
        size = f"its longest side of {own:.3g} m is doubtful, as of meshes scaled to a unit cube"
    else:
        size = f"its longest side is {taken:.3g} m, as the file's {own:.3g} m is out of range"
    return f"{size}, and distances are unknown: --length states it"
