"""How materials look to the path tracer: by kind and roughness, and the object's finishes."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np

from vig.scene import ShapeModel
from vig.synthesis.cycles.decorations import decoration

Finish = Literal["diffuse", "glossy", "painted"]
FINISHES: tuple[Finish, ...] = ("diffuse", "glossy", "painted")

COAT_ROUGHNESS = (0.1, 0.4)
"""Of the glaze on a `glossy` or `painted` object, drawn anew for each sample."""
DECORATION_SIZE = 128

_KINDS: dict[str, dict[str, float]] = {
    "metal": {"Metallic": 1.0},
    "cloth": {"Specular IOR Level": 0.1, "Sheen Weight": 0.3},
    "weave": {"Specular IOR Level": 0.1, "Sheen Weight": 0.3},
    "earth": {"Specular IOR Level": 0.1},
    "brick": {"Specular IOR Level": 0.2},
    "paper": {"Specular IOR Level": 0.25},
    "wallpaper": {"Specular IOR Level": 0.1},
    "paint": {"Specular IOR Level": 0.2},
}
"""What differs from a plain dielectric of index 1.5, by the material's kind or its finish's."""


def appearance(
    kind: str, roughness: float, emission: float, colour: np.ndarray, texture: str | None
) -> dict[str, Any]:
    """A thing's material as plain data: kind, roughness and emission of `vig.synthesis.props.Material`.

    texture: name of the array that holds its albedo; None for a single `colour` (3,), linear.
    """
    return {
        "lambertian": False,
        "texture": texture,
        "colour": colour.tolist(),
        "roughness": roughness,
        "emission": emission,
        "principled": _KINDS.get(kind, {}),
    }


def lambertian(albedo: np.ndarray) -> dict[str, Any]:
    """The object's material in the finish `diffuse`: albedo (3,), as in vig's model."""
    return {
        "lambertian": True,
        "texture": None,
        "colour": albedo.tolist(),
        "roughness": 0.0,
        "emission": 0.0,
        "principled": {},
    }


def coated(albedo: np.ndarray, roughness: float, texture: str | None) -> dict[str, Any]:
    """A Lambertian base under a clear coat of index 1.5 and the given roughness."""
    principled = {"Specular IOR Level": 0.0, "Coat Weight": 1.0, "Coat Roughness": roughness, "Coat IOR": 1.5}
    return {
        "lambertian": False,
        "texture": texture,
        "colour": albedo.tolist(),
        "roughness": 1.0,
        "emission": 0.0,
        "principled": principled,
    }


def painted(albedo: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """The albedo (3,) with a painted decoration over it: (h, w, 3) linear, u round the axis, row 0 on top."""
    layer = decoration(rng, DECORATION_SIZE)
    cover = layer[..., 3:]
    return ((1 - cover) * albedo + cover * layer[..., :3]).astype(np.float32)


def cylindrical_uv(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Texture coordinates (F, 3, 2) of the faces' corners: u once round the +Z axis, v from foot to top.

    A face that crosses the seam goes on past u = 1, where the texture repeats.
    """
    u = np.arctan2(vertices[:, 1], vertices[:, 0]) / (2 * np.pi)
    heights = vertices[faces, 2]
    low, high = heights.min(), heights.max()
    corners = np.stack([u, (vertices[:, 2] - low) / (high - low)], axis=1)[faces]
    around = corners[..., 0]
    around += around.max(axis=1, keepdims=True) - around > 0.5
    return corners.astype(np.float32)


def painted_faces(model: ShapeModel) -> np.ndarray:
    """Faces (F,) bool that a decoration covers: those of the part `body`, or all where there is none."""
    if "body" not in model.part_names:
        return np.ones(len(model.faces), bool)
    return (model.parts == model.part_names.index("body"))[model.faces].all(axis=1)
