"""Appearance of materials in the path tracer: by kind and roughness, and the object's."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from vig.scene import IMAGE_SIZE, ShapeModel
from vig_world.assets.coats import albedo_of
from vig_world.assets.things import Material
from vig_world.dataset.spec import Coat

TEXELS, RIM = 10, 1
"""Texels a side of each face's own square of a baked coat, and those at its edges for interpolation."""
TEXELS_FINE, FINE_FROM = 30, 2 * IMAGE_SIZE
"""The same in larger images, and pixels a side from which an image counts as such."""


@dataclass(frozen=True)
class _Look:
    """Look of things of one kind, besides their texture and roughness.

    specular: reflectance from the front as Blender counts it, 0.5 being 4 %. polish: share of them that
    have a clear coat (varnish, glaze, wax), of a roughness drawn from `gloss`. relief: metres by which light
    parts of the texture stand above black ones.
    """

    specular: float = 0.5
    metallic: float = 0.0
    sheen: float = 0.0
    polish: float = 0.0
    gloss: tuple[float, float] = (0.05, 0.3)
    relief: float = 0.0


_TIMBER = _Look(polish=0.6, gloss=(0.08, 0.35), relief=0.0005)
_STONE = _Look(polish=0.85, gloss=(0.03, 0.2))
_TEXTILE = _Look(specular=0.1, sheen=0.3, relief=0.001)
_PRINTED = _Look(specular=0.25)
_KINDS: dict[str, _Look] = {
    "metal": _Look(metallic=1.0),
    "ceramic": _Look(polish=0.8, gloss=(0.03, 0.2)),
    "glass": _Look(polish=1.0, gloss=(0.0, 0.05)),
    "leaf": _Look(specular=0.4, polish=0.4, gloss=(0.25, 0.45)),
    "skin": _Look(polish=0.5, gloss=(0.2, 0.45)),
    "earth": _Look(specular=0.1, relief=0.003),
    "paint": _Look(polish=0.5, gloss=(0.1, 0.4)),
    "leather": _Look(polish=0.4, gloss=(0.3, 0.5), relief=0.0005),
    "linoleum": _Look(polish=0.6, gloss=(0.2, 0.45)),
    "brick": _Look(specular=0.2, relief=0.004),
    "concrete": _Look(specular=0.2, relief=0.001),
    "plaster": _Look(specular=0.2, relief=0.001),
    "cork": _Look(specular=0.2, relief=0.001),
    "tiles": _Look(polish=0.9, gloss=(0.05, 0.25), relief=0.001),
    **dict.fromkeys(("wood", "parquet", "herringbone"), _TIMBER),
    **dict.fromkeys(("marble", "granite", "terrazzo", "checker", "speckle"), _STONE),
    **dict.fromkeys(("cloth", "weave"), _TEXTILE),
    **dict.fromkeys(("paper", "page", "print", "picture", "wallpaper", "floral", "stripes"), _PRINTED),
}
"""Looks by kind of material (`vig_world.assets.things.Material`) or, for finishes, of texture; else plain."""


def appearance(material: Material, texture: str | None, rng: np.random.Generator) -> dict[str, Any]:
    """Return a thing's material as plain data.

    Args:
        material: Its kind, roughness and emission count.
        texture: Name of the array that holds its albedo; None for the one colour of its texture.
        rng: Draws whether it is polished, always the same number of times.
    """
    look = _KINDS.get(material.kind, _Look())
    chance, weight, gloss = rng.uniform(size=3)
    low, high = look.gloss
    principled = {
        "Metallic": look.metallic,
        "Specular IOR Level": look.specular,
        "Sheen Weight": look.sheen,
        "Coat Weight": 0.3 + 0.7 * weight if chance < look.polish else 0.0,
        "Coat Roughness": low + (high - low) * gloss,
    }
    flat = _material(material.texture[0, 0], texture, material.roughness, principled)
    return flat | {"emission": material.emission, "relief": look.relief if texture else 0.0}


def _material(
    colour: np.ndarray, texture: str | None, roughness: float, principled: dict[str, float]
) -> dict[str, Any]:
    """Return a flat material that emits nothing; principled: inputs of Blender's shader of that name."""
    return {
        "lambertian": False,
        "texture": texture,
        "colour": colour.tolist(),
        "roughness": roughness,
        "emission": 0.0,
        "relief": 0.0,
        "principled": principled,
    }


def lambertian(albedo: np.ndarray) -> dict[str, Any]:
    """Return the material of an object without a coat: albedo (3,), as in vig's model."""
    return _material(albedo, None, 0.0, {}) | {"lambertian": True}


def coat_material(coat: Coat, texture: str) -> dict[str, Any]:
    """Return the material of an object with a coat, whose albedo is in a texture.

    It is metal, or Lambertian under a clear coat of index 1.5.
    """
    grey = np.full(3, 0.5)
    if coat.metal:
        return _material(grey, texture, coat.roughness, {"Metallic": 1.0})
    clear = {"Coat Weight": coat.gloss, "Coat Roughness": coat.roughness, "Coat IOR": 1.5}
    return _material(grey, texture, 1.0, {"Specular IOR Level": 0.0} | clear)


def bake_texture(
    coat: Coat, vertices: np.ndarray, model: ShapeModel, texels: int = TEXELS
) -> tuple[np.ndarray, np.ndarray]:
    """Return a coat's albedo as a texture (h, w, 3), linear, row 0 on top; corners' coordinates (F, 3, 2).

    Each face has a square of `texels` a side to itself, of which it fills the lower left half but for a rim.
    """
    faces = model.faces
    columns = math.ceil(math.sqrt(len(faces)))
    rows = math.ceil(len(faces) / columns)
    inner = texels - 2 * RIM
    step = (np.arange(texels) + 0.5 - RIM) / inner
    b, c = (grid.ravel() for grid in np.meshgrid(step, step))
    weights = np.stack([1 - b - c, b, c], 1)
    points = np.einsum("tk,fkd->ftd", weights, vertices[faces]).reshape(-1, 3)
    part = np.repeat(model.parts[faces[:, 0]], texels**2)
    albedo = albedo_of(coat, points, part, float(model.mean[:, 2].max()))
    cells = np.zeros((rows * columns, texels, texels, 3), np.float32)
    cells[: len(faces)] = albedo.reshape(len(faces), texels, texels, 3)
    image = cells.reshape(rows, columns, texels, texels, 3).swapaxes(1, 2).reshape(rows * texels, -1, 3)
    row, column = np.divmod(np.arange(len(faces)), columns)
    start = np.stack([column, row], 1)[:, None] * texels + RIM
    corners = start + inner * np.array([[0, 0], [1, 0], [0, 1]])
    uv = corners / [columns * texels, rows * texels]
    return image[::-1], uv.astype(np.float32)
