"""Materials of props, and props as meshes with materials."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from vig_world.assets.textures import (
    Array,
    accent,
    colour,
    decoration,
    near,
    neutral,
    partner,
    shade,
    texture,
)
from vig_world.mesh import Mesh


@dataclass(frozen=True)
class Material:
    """A surface.

    Attributes:
        texture: (h, w, 3) float32 linear albedo, row 0 the top (v = 1), repeated outside [0, 1].
        kind: Its substance: ceramic, glass, metal, wood, paper, plastic, cloth, leaf, skin (of fruit), wax,
            earth.
        roughness: In [0, 1], 0 a mirror; for path tracers only.
        slot: A surface whose finish each sample chooses anew (`wall`, `floor`, `ceiling`, `wood`, `top`,
            `fabric`), the texture standing in for it; texture coordinates are metres there. Empty: it is
            kept.
        emission: Radiance that the surface emits (linear, 1 = white paper in the exposed picture).
    """

    texture: Array
    kind: str
    roughness: float
    slot: str = ""
    emission: float = 0.0


@dataclass(frozen=True)
class Prop:
    """A household object, metres, standing on z = 0 with its bounding box centred at x = y = 0.

    Attributes:
        parts: Meshes with texture coordinates, each with its material.
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


def plain(kind: str, rng: np.random.Generator, base: ArrayLike | None = None) -> Material:
    """One colour, `base` or any."""
    texture = np.tile(
        np.clip(colour(rng) if base is None else base, 0.02, 0.95).astype(np.float32), (4, 4, 1)
    )
    return Material(texture, kind, float(rng.uniform(*_ROUGHNESS[kind])))


def plastic(rng: np.random.Generator) -> Material:
    """Plastic: white, grey and black mostly, sometimes of a colour."""
    return plain("plastic", rng, neutral(rng) if rng.uniform() < 0.6 else accent(rng))


def dark(rng: np.random.Generator) -> Material:
    """Black or nearly black plastic, rubber or lacquer."""
    return plain("plastic", rng, np.full(3, rng.uniform(0.02, 0.06)))


def timber(rng: np.random.Generator, size: int = 64) -> Material:
    """Wood, bare or oiled."""
    return material("wood", rng, "wood", size=size)


def ceramic(rng: np.random.Generator, base: ArrayLike | None = None) -> Material:
    """Glazed ceramics: mostly plain, sometimes speckled, dipped in a second glaze, or painted.

    Made for the profiles of `vessel`, whose outer wall takes up about the v from 0.14 to 0.52.
    """
    base = (neutral(rng) if rng.uniform() < 0.35 else colour(rng)) if base is None else np.asarray(base)
    style = rng.choice(5, p=[0.5, 0.14, 0.14, 0.14, 0.08])
    if style == 0:
        return material("ceramic", rng, "paint", base, 32)
    if style == 1:
        return material("ceramic", rng, "speckle", base, 128)
    if style == 2:
        return Material(_dipped(rng, base), "ceramic", float(rng.uniform(0.15, 0.5)))
    if style == 3:
        white = shade([0.80, 0.79, 0.75], rng, 0.08) if rng.uniform() < 0.7 else base
        return Material(_painted(rng, white), "ceramic", float(rng.uniform(*_ROUGHNESS["ceramic"])))
    return material("ceramic", rng, str(rng.choice(["wallpaper", "stripes", "marble"])), base)


def bare(glaze: Material) -> Material:
    """The ground of a glaze without what is painted on it, for handles and spouts."""
    ground = glaze.texture[2:4, 2:4].mean(axis=(0, 1))  # of the inside, see `vessel`
    return replace(glaze, texture=np.tile(ground, (4, 4, 1)))


def _dipped(rng: np.random.Generator, base: Array) -> Array:
    """A glaze that ends in a line above the foot, over clay or a second glaze, thin and brown at the rim."""
    image = texture("speckle" if rng.uniform() < 0.5 else "paint", rng, 64, base)
    below = shade([0.46, 0.30, 0.18], rng) if rng.uniform() < 0.5 else partner(base, rng)
    v = 1 - (np.arange(64)[:, None] + 0.5) / 64
    line = rng.uniform(0.18, 0.38) + 0.02 * np.sin(np.arange(64) * 2 * np.pi / 64 * rng.integers(1, 4))
    image += (below - image) * np.clip(64 * (line - v) + 0.5, 0, 1)[..., None]
    rim = np.exp(-(((v[:, 0] - 0.53) / 0.02) ** 2)) * rng.uniform(0, 0.8)
    return (image * (1 - 0.6 * rim[:, None, None])).clip(0.02, 0.95).astype(np.float32)


def _painted(rng: np.random.Generator, base: Array) -> Array:
    """A decoration round the outer wall, (128, 48, 3)."""
    image = np.empty((128, 48, 3), np.float32)
    image[:] = base
    layer = decoration(rng, 48)[:, :48]
    cover = layer[..., 3:]
    image[60:108] = layer[..., :3] * cover + image[60:108] * (1 - cover)
    return image


_METALS = np.array(
    [[0.56, 0.56, 0.56], [0.42, 0.42, 0.42], [0.58, 0.43, 0.20], [0.58, 0.31, 0.20], [0.20, 0.20, 0.21]],
    np.float32,
)


def steel(rng: np.random.Generator) -> Material:
    """Stainless steel or aluminium, brushed or bright."""
    return material("metal", rng, "paint", shade(_METALS[rng.integers(2)], rng, 0.1), 16)


def metal(rng: np.random.Generator) -> Material:
    """Steel, brass, copper or blackened iron."""
    base = _METALS[rng.choice(5, p=[0.35, 0.2, 0.18, 0.1, 0.17])]
    return material("metal", rng, "paint", near(base, rng, 0.08), 16)


def label(rng: np.random.Generator, size: int = 128) -> Material:
    """A printed label."""
    return material("paper", rng, "print", size=size)
