"""Custom furniture from mesh files, with the supports found on it."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from vig.io.errors import UserError
from vig_world.assets.own.furniture_families import family_of_file
from vig_world.assets.own.props import read_each
from vig_world.assets.own.settings import FileSettings
from vig_world.assets.own.standing import SizedKind
from vig_world.assets.own.supports import level_areas
from vig_world.assets.things import Furniture, FurnitureModel, Parts, Support
from vig_world.mesh import stack_meshes

_FURNITURE = SizedKind("piece of furniture", 0.3, 4.0, furniture=True)
_LOWEST = 0.25
_ZONES = {
    "nightstand": "bedside", "coffee_table": "reading", "desk": "desk", "counter": "cooking",
    "cabinet": "display", "sofa": "reading", "armchair": "reading", "stool": "reading", "bench": "reading",
    "chair": "reading", "bed": "bedside",
}  # fmt: skip


def read_furniture(folder: str | Path) -> tuple[list[FurnitureModel], list[str]]:
    """Read every mesh file below a folder, or of furniture catalogues, as furniture, in the order of names.

    Args:
        folder: A folder, or another argument of `mesh_folder`, such as `catalogue.sh3f:chair`.

    Returns:
        The pieces, and one sentence for each skipped file and for each guess. A piece on which nothing can
        stand is kept, with a sentence, if it is `_LOWEST` or higher.

    Raises:
        UserError: When there is no such folder, not one usable file in it, or its `vig.toml` is wrong.
    """
    return read_each(folder, _FURNITURE, _make)


def _make(name: str, mark: str, parts: Parts, settings: FileSettings) -> tuple[FurnitureModel, list[str]]:
    vertices, faces = stack_meshes([mesh for mesh, _ in parts])
    family = settings.family or family_of_file(name)
    areas = level_areas(vertices.astype(np.float64), faces)
    height = float(vertices[:, 2].max())
    if not areas and height < _LOWEST:
        raise UserError(f"{name}: expected furniture; got {height:.2f} m high without a support.")
    supports = tuple(_support(area, family, settings.zones, i) for i, area in enumerate(areas))
    notes = [] if supports else ["found no level area of 15 x 15 cm with 20 cm of free space above it"]
    piece = Furniture(family, parts, supports)
    return FurnitureModel(name, family, mark, lambda: piece), notes


def _support(area: Support, family: str, zones: tuple[str, ...], number: int) -> Support:
    """Return an area with its zone: from the settings (in turn, if several), the family, or its height."""
    height = area.centre[2]
    if zones:
        zone = zones[number % len(zones)]
    elif family in _ZONES:
        zone = "storage" if family == "cabinet" and np.isfinite(area.clearance) else _ZONES[family]
    elif family == "shelf" or np.isfinite(area.clearance):
        zone = "display" if height > 0.6 else "storage"
    else:
        limits = {"reading": 0.6, "dining": 0.85, "cooking": 1.0}
        zone = next((name for name, limit in limits.items() if height < limit), "display")
    return replace(area, zone=zone)
