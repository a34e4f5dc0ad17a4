"""Reads the packaged models: meshes of 12 bits a coordinate, colours of parts, small pictures, supports.

`tools/make_models.py` writes the two files; a row of `models.csv` is a model, in the order of the arrays.
"""

import csv
import functools
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from vig.io.checks import decode
from vig.scene import linear_from_srgb
from vig_world.assets.materials import ROUGHNESS
from vig_world.assets.models.unwrapping import unwrap
from vig_world.assets.textures import BRIGHTEST, DARKEST
from vig_world.assets.things import (
    ZONE_NAMES,
    AssetModel,
    Content,
    Furniture,
    FurnitureModel,
    Material,
    Parts,
    PropModel,
    Support,
)
from vig_world.dataset.spec import Split

FOLDER = Path(__file__).parent
STEPS = 4095  # steps of a coordinate over the extent of a model's bounding box
KINDS = tuple(ROUGHNESS)
SLOTS = ("", "wood", "top", "fabric")  # kinds and slots of parts, by their numbers in the file


@dataclass(frozen=True)
class ModelRow:
    """One line of `models.csv`.

    Attributes:
        role: `prop` or `furniture`.
        name: Unique.
        family: Its kind, such as `vase`; for furniture the family that rooms request, such as `dining_table`.
        split: The only split that shows it.
        zones: Zones to which a prop belongs, separated by spaces; empty for furniture.
        title: Its author's name for it.
        author: The model's author.
        licence: Licence of its publication.
        catalogue: The file that it comes from.
        width, depth, height: Metres.
        faces: Number of triangles.
    """

    role: str
    name: str
    family: str
    split: Split
    zones: str
    title: str
    author: str
    licence: str
    catalogue: str
    width: str
    depth: str
    height: str
    faces: str


@functools.cache
def rows() -> tuple[ModelRow, ...]:
    """Return the packaged models, in the order of the file."""
    with (FOLDER / "models.csv").open(encoding="utf-8", newline="") as file:
        return tuple(decode(ModelRow, row) for row in csv.DictReader(file))


@functools.cache
def packaged_props(split: Split) -> dict[str, tuple[PropModel, ...]]:
    """Return the props of a split by family."""
    return _by_family("prop", split, _parts)


@functools.cache
def packaged_furniture(split: Split) -> dict[str, tuple[FurnitureModel, ...]]:
    """Return the furniture of a split by family."""
    return _by_family("furniture", split, _furniture)


def _by_family(
    role: str, split: Split, read: Callable[[int], Content]
) -> dict[str, tuple[AssetModel[Content], ...]]:
    """Return models by family, in alphabetical order, on which random draws depend."""
    families: dict[str, tuple[AssetModel[Content], ...]] = {}
    for number, row in enumerate(rows()):
        if row.role == role and row.split == split:
            zones = tuple(row.zones.split())
            model = AssetModel(row.name, row.family, "", functools.partial(read, number), zones, True)
            families[row.family] = (*families.get(row.family, ()), model)
    return dict(sorted(families.items()))


@functools.cache
def _arrays() -> dict[str, np.ndarray]:
    """Return the arrays of `models.npz`: ends (M, 2), boxes (M, 6), parts (P, 6), colours (P, 3) sRGB,
    vertices (V, 3), faces (F, 3), uv (U, 2), uv_boxes (P, 4), pictures (T, S, S), palettes (T, C, 3) sRGB,
    supports (S, 9).
    """
    with np.load(FOLDER / "models.npz") as file:
        return {name: file[name] for name in file.files}


def _furniture(number: int) -> Furniture:
    """Decode a piece of furniture."""
    arrays = _arrays()
    first = int(arrays["ends"][number - 1, 1]) if number else 0
    supports = tuple(
        Support(ZONE_NAMES[int(zone)], (x, y, z), (half_x, half_y), turn, clearance, behind)
        for zone, x, y, z, half_x, half_y, turn, clearance, behind in arrays["supports"][
            first : arrays["ends"][number, 1]
        ]
        .astype(float)
        .tolist()
    )
    return Furniture(rows()[number].family, _parts(number), supports)


@functools.lru_cache(maxsize=512)
def _parts(number: int) -> Parts:
    """Decode a model: parts with pictures have their own texture coordinates, all others metres."""
    arrays = _arrays()
    ends, table = arrays["ends"], arrays["parts"]
    low, size = np.split(arrays["boxes"][number].astype(np.float64), 2)
    result = []
    for part in range(int(ends[number - 1, 0]) if number else 0, int(ends[number, 0])):
        start = table[part - 1] if part else np.zeros(6, int)
        vertex, face, coordinate, picture, slot, kind = table[part].tolist()
        vertices = low + arrays["vertices"][start[0] : vertex] * (size / STEPS)
        faces = arrays["faces"][start[1] : face].astype(np.int64)
        uv = None
        if picture >= 0:
            corner, extent = np.split(arrays["uv_boxes"][part].astype(np.float64), 2)
            uv = corner + arrays["uv"][start[2] : coordinate] * (extent / STEPS)
        mesh = unwrap(vertices, faces, uv)
        result.append((mesh, _material(arrays, part, picture, SLOTS[slot], kind)))
    return tuple(result)


def _material(arrays: dict[str, np.ndarray], part: int, picture: int, slot: str, kind: int) -> Material:
    if picture < 0:
        srgb = arrays["colours"][part].reshape(1, 1, 3)
    else:
        srgb = arrays["palettes"][picture][arrays["pictures"][picture]]
    albedo = linear_from_srgb(srgb.astype(np.float64) / 255).clip(DARKEST, BRIGHTEST).astype(np.float32)
    glows = kind >= len(KINDS)
    name = "paper" if glows else KINDS[kind]
    # radiance of a lit lampshade, over white paper's
    return Material(albedo, name, float(np.mean(ROUGHNESS[name])), slot, 1.5 if glows else 0.0)
