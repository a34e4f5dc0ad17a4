"""Class packs of single meshes, made by a package that reads meshes."""

from collections.abc import Callable
from importlib.metadata import entry_points
from importlib.util import find_spec
from pathlib import Path

from vig.io.errors import UserError

SUFFIXES = (".glb", ".gltf", ".obj", ".ply", ".off", ".stl")  # endings of the mesh files that are read
GROUP = "vig.meshes"
"""Entry points of functions that make a class pack of a mesh file: path, length, `say`, up in, folder out."""


def pack_of_mesh(
    mesh: str | Path, length: float | None, say: Callable[[str], None], up: str | None = None
) -> Path:
    """Return the class pack of a mesh file; UserError for no mesh, or without a maker of packs."""
    for point in entry_points(group=GROUP):
        if find_spec(point.module.partition(".")[0]) is not None:
            try:
                folder: Path = point.load()(Path(mesh), length, say, up)
            except ModuleNotFoundError as error:
                needed = f"expected the package {error.name}; it is not installed."
                raise UserError(f"{needed} Run pip install 'vig[world]'.") from None
            return folder
    raise UserError("expected the package vig_train, to read a mesh; it is not installed. Install vig anew.")
