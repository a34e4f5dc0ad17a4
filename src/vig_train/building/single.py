"""A class of exact shape from one mesh file, as `vig fit --mesh` needs it."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Callable
from pathlib import Path

from vig.io.errors import UserError
from vig_train.building.build import build_class, is_step
from vig_train.building.settings import BuildSettings
from vig_world.asset_cache import asset_cache
from vig_world.assets.own.folder import fingerprint
from vig_world.assets.own.load import SUFFIXES, load

EDITION = 2
"""Of the packs: those that an earlier vig made another way stay unused."""


def pack_of_mesh(
    mesh: Path, length: float | None = None, say: Callable[[str], None] = lambda line: None
) -> Path:
    """The class pack of a mesh file, without a recognizer; made at most once for each content.

    It lies in the user's cache folder; where nothing can be written there, in one that is made anew.
    `length` is the object's longest side, metres, where the file is not in metres. `say` is called with a
    line before each step that takes time.

    Raises:
        UserError: It is no mesh that can be used.
    """
    mesh = Path(mesh)
    if not mesh.is_file() or mesh.suffix.lower() not in SUFFIXES:
        came = "a folder" if mesh.is_dir() else "no such file" if not mesh.exists() else f"'{mesh.name}'"
        raise UserError(f"expected --mesh FILE, one of {' '.join(SUFFIXES)}; got {came}. Check the path.")
    key = (
        fingerprint(load(mesh.parent, mesh).files)[:24]
        + f"-{EDITION}"
        + ("" if length is None else f"-{length:g}m")
    )
    cache = asset_cache().folder
    parent = Path(tempfile.mkdtemp(prefix="vig-mesh-")) if cache is None else cache / "meshes"
    pack = parent / f"{mesh.stem[:60]}-{key}"
    if (pack / "class.json").is_file():
        return pack
    say(f"'{mesh.name}' is made ready, once for each file: some 15 seconds, a minute on a busy machine")
    parent.mkdir(parents=True, exist_ok=True)
    making = Path(tempfile.mkdtemp(prefix="making-", dir=parent))
    try:
        settings = BuildSettings(mesh.stem[:100], length=length, materials=False)
        build_class(mesh, making / "pack", settings, lambda line: say(line) if is_step(line) else None)
        try:
            (making / "pack").rename(pack)
        except OSError:  # another process was faster
            if not (pack / "class.json").is_file():
                raise
    finally:
        shutil.rmtree(making, ignore_errors=True)
    return pack
