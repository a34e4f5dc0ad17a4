"""What props are made of."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from vig.scene import Mesh
from vig.synthesis.textures import Array, colour, near, texture


@dataclass(frozen=True)
class Material:
    """A surface.

    texture: (h, w, 3) float32 linear albedo, row 0 the top (v = 1), repeated outside [0, 1].
    kind: what it is: ceramic, glass, metal, wood, paper, plastic, cloth, leaf, skin (of fruit), wax, earth.
    roughness: in [0, 1], 0 a mirror; for path tracers only.
    slot: a surface whose finish each sample chooses anew (`wall`, `floor`, `ceiling`, `wood`, `top`,
    `fabric`), the texture standing in for it; texture coordinates are metres there. Empty: it is kept.
    emission: radiance (linear, 1 = white paper in the exposed picture) that the surface sends out by itself.
    """

    texture: Array
    kind: str
    roughness: float
    slot: str = ""
    emission: float = 0.0


@dataclass(frozen=True)
class Prop:
    """A household object, metres, standing on z = 0 with its bounding box centred at x = y = 0.

    parts: meshes with texture coordinates, each with its material.
    """

    family: str
    parts: tuple[tuple[Mesh, Material], ...]


def prop(family: str, *parts: tuple[Mesh, Material]) -> Prop:
    """A Prop of the parts, shifted together to stand on z = 0 centred at x = y = 0."""
    points = np.concatenate([mesh.vertices for mesh, _ in parts]).astype(np.float64)
    low, high = points.min(0), points.max(0)
    origin = np.array([(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, low[2]])
    shifted = [
        (Mesh((mesh.vertices - origin).astype(np.float32), mesh.faces, mesh.uv), material)
        for mesh, material in parts
    ]
    return Prop(family, tuple(shifted))


_ROUGHNESS = {
    "ceramic": (0.08, 0.4),
    "glass": (0.03, 0.15),
    "metal": (0.15, 0.5),
    "wood": (0.4, 0.8),
    "paper": (0.5, 0.9),
    "plastic": (0.2, 0.6),
    "cloth": (0.85, 1.0),
    "leaf": (0.4, 0.7),
    "skin": (0.3, 0.7),
    "wax": (0.4, 0.7),
    "earth": (0.9, 1.0),
}


def material(
    kind: str, rng: np.random.Generator, pattern: str = "paint", base: ArrayLike | None = None, size: int = 64
) -> Material:
    """A material with a texture of kind `pattern` (see `textures.KINDS`), of main colour `base` if given."""
    return Material(texture(pattern, rng, size, base), kind, float(rng.uniform(*_ROUGHNESS[kind])))


def ceramic(rng: np.random.Generator, base: ArrayLike | None = None) -> Material:
    """Glazed ceramics: mostly plain, sometimes speckled or with a pattern."""
    plain = rng.uniform() < 0.65
    pattern = "paint" if plain else str(rng.choice(["speckle", "wallpaper", "checker", "terrazzo", "marble"]))
    return material("ceramic", rng, pattern, colour(rng) if base is None else base, 64 if plain else 128)


def metal(rng: np.random.Generator) -> Material:
    """Steel, brass or copper."""
    metals = np.array(
        [[0.55, 0.56, 0.57], [0.60, 0.45, 0.20], [0.60, 0.32, 0.20], [0.30, 0.30, 0.31]], np.float32
    )
    return material(
        "metal", rng, "paint", near(metals[rng.choice(4, p=[0.55, 0.15, 0.1, 0.2])], rng, 0.08), 32
    )


def label(rng: np.random.Generator) -> Material:
    """A printed label."""
    return material("paper", rng, "print", size=128)
