"""Custom props from mesh files."""

from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from vig.io.errors import UserError
from vig.known_object.packs import SUFFIXES
from vig_world.assets.own.catalogue import mesh_folder, read_sources
from vig_world.assets.own.folder import fingerprint
from vig_world.assets.own.load import MeshPiece, load, mesh_files
from vig_world.assets.own.settings import FileSettings, settings_of
from vig_world.assets.own.simplify import outward
from vig_world.assets.own.standing import SizedKind, stand
from vig_world.assets.things import Material, Parts, PropModel, prop
from vig_world.mesh import Mesh

MAX_FACES = 20_000
_PROP = SizedKind("prop", 0.01, 0.6, furniture=False)


def read_props(folder: str | Path) -> tuple[list[PropModel], list[str]]:
    """Read every mesh file below a folder, or of furniture catalogues, as a prop, in the order of names.

    Args:
        folder: A folder, or another argument of `mesh_folder`, such as `catalogue.sh3f:car`.

    Returns:
        The props, and one sentence for each skipped file and for each guess.

    Raises:
        UserError: When there is no such folder, not one usable file in it, or its `vig.toml` is wrong.
    """

    def made(name: str, mark: str, parts: Parts, settings: FileSettings) -> tuple[PropModel, list[str]]:
        return PropModel(name, settings.family or _family_of(name), mark, lambda: parts, settings.zones), []

    return read_each(folder, _PROP, made)


def _family_of(name: str) -> str:
    """Return a thing's name: its file's stem, or its folder's name if that is generic, such as `model`."""
    path = Path(name)
    generic = ("textured", "model", "mesh", "object", "scene", "untitled", "nontextured")
    return path.parent.name if path.stem.lower() in generic and path.parent.name else path.stem


def read_each(
    folder: str | Path,
    kind: SizedKind,
    made: Callable[[str, str, Parts, FileSettings], tuple[Any, list[str]]],
) -> tuple[list[Any], list[str]]:
    """Apply `made` to the name, fingerprint, parts and settings of each mesh; return problems, too."""
    root = mesh_folder(folder)
    results, cache = [], {}  # type: ignore[var-annotated]
    problems = [f"{model}: {why} Left out." for model, why in read_sources(root).left_out.items()]
    skipped = 0
    files, unread = mesh_files(root)
    problems += [f"{name}: expected one of {' '.join(SUFFIXES)}. Left out." for name in unread]
    for name, path in files:
        settings = settings_of(root, path, cache)
        if settings.skip:
            skipped += 1
            continue
        try:
            loaded = load(root, path, settings.nodes)
            parts, guesses = standing_parts(path, loaded.pieces, settings, kind)
            mark = fingerprint({**loaded.files, "vig.toml": repr(sorted(asdict(settings).items())).encode()})
            result, notes = made(name, mark, prop("", *parts).parts, settings)
        except UserError as error:
            problems.append(f"{error} Left out.")
            continue
        results.append(result)
        problems += [f"{path}: {note}." for note in loaded.notes + guesses + notes]
    if not results:
        skips = f"{skipped} with skip = true. " if skipped else ""
        raise UserError(f"{folder}: not one usable {kind.noun}. {skips}{' '.join(problems)}")
    return results, problems


def standing_parts(
    path: Path, pieces: list[MeshPiece], settings: FileSettings, kind: SizedKind
) -> tuple[Parts, list[str]]:
    """Return the parts of a mesh file, upright in metres and of `MAX_FACES` at most, and the guesses made.

    Raises UserError when it has no triangle with an area, or no usual unit makes it one of this kind.
    """
    try:
        pieces = outward(pieces, MAX_FACES)
        if not pieces:
            raise ValueError("triangles with an area; all of its are degenerate")
        pieces, guesses = stand(pieces, settings, path.suffix.lower(), kind)
    except UserError:
        raise
    except ValueError as error:
        raise UserError(f"{path}: expected {error}.") from error
    plastic = tuple(  # files do not name their materials
        (
            Mesh(
                piece.vertices.astype(np.float32),
                np.ascontiguousarray(piece.faces, np.int32),
                piece.uv.astype(np.float32),
            ),
            Material(piece.texture, "plastic", 0.5),
        )
        for piece in pieces
    )
    return plastic, guesses
