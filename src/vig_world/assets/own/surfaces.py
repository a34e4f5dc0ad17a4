"""Colours of imported meshes as textures: linear albedo, at most 256 x 256 texels."""

from __future__ import annotations

from typing import Any

import numpy as np
from PIL import Image

from vig.scene import linear_from_srgb
from vig_world.assets.textures import BRIGHTEST, DARKEST

MOST_TEXELS = 256
MOST_PIXELS = 50_000_000
"""Of a picture before it is made smaller."""
GREY = 0.5
"""Albedo where a file has no readable colour."""
_PALETTE = 64

Painted = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]


def painted(vertices: np.ndarray, faces: np.ndarray, visual: Any, gltf: bool) -> Painted:
    """Vertices, faces, texture coordinates (V, 2) and texture (h, w, 3) of a mesh with trimesh's visual.

    A mesh coloured by vertex or face gets a palette for a texture, its vertices doubled between colours.
    """
    blank = np.zeros((len(vertices), 2), np.float32)
    material, uv = getattr(visual, "material", None), getattr(visual, "uv", None)
    if material is not None:
        image = getattr(material, "baseColorTexture", None) if gltf else getattr(material, "image", None)
        colour = getattr(material, "baseColorFactor" if gltf else "diffuse", None)
        rgb = _rgb(colour, linear=gltf)
        texture = _linear(image) if image is not None else None
        if texture is not None and uv is not None and len(uv) == len(vertices):
            coordinates = np.nan_to_num(np.asarray(uv, np.float32)[:, :2], posinf=0.0, neginf=0.0)
            # Many programs leave MTL's Kd at 0 or 0.8 beside a picture, so the picture alone counts.
            return vertices, faces, coordinates, _albedo(texture * rgb if gltf else texture)
        return vertices, faces, blank, _albedo(rgb[None, None])
    if getattr(visual, "kind", None) in ("vertex", "face"):
        return _by_palette(vertices, faces, np.asarray(visual.face_colors)[:, :3], linear=gltf)
    return vertices, faces, blank, _albedo(np.full((1, 1, 3), GREY))


def opacity_of(visual: Any, gltf: bool) -> float:
    """Of a mesh with trimesh's visual, from 0 to 1: a glTF's factor where it blends, MTL's d or 1 - Tr."""
    material = getattr(visual, "material", None)
    try:
        if gltf:
            blends = getattr(material, "alphaMode", None) == "BLEND"
            colour = getattr(material, "baseColorFactor", None)
            if not blends or colour is None:
                return 1.0
            opacity = np.asarray(colour).ravel()[3] / (255 if np.asarray(colour).dtype.kind in "iu" else 1)
        else:
            stated = getattr(material, "kwargs", {})
            opacity = float(stated["d"][0]) if "d" in stated else 1 - float(stated["tr"][0])
    except (KeyError, IndexError, TypeError, ValueError):
        return 1.0
    return float(np.clip(opacity, 0.0, 1.0)) if np.isfinite(opacity) else 1.0


def _albedo(values: np.ndarray) -> np.ndarray:
    return np.clip(values, DARKEST, BRIGHTEST).astype(np.float32)


def _rgb(colour: Any, linear: bool) -> np.ndarray:
    """A colour (3,) in linear light of trimesh's, bytes or fractions; white when there is none."""
    if colour is None:
        return np.ones(3)
    values = np.asarray(colour)
    values = values[:3].astype(np.float64) / (255 if np.issubdtype(values.dtype, np.integer) else 1)
    return np.clip(values if linear else linear_from_srgb(values), 0, 1)


def _linear(image: Image.Image) -> np.ndarray | None:
    """A picture as linear RGB, each side at most MOST_TEXELS; None when it cannot be decoded."""
    if image.width * image.height > MOST_PIXELS:
        return None
    try:
        image.load()
    except Exception:  # a decoder may raise anything on a damaged picture
        return None
    small = image.convert("RGBA") if image.mode in ("P", "PA") else image
    if small.mode.startswith("I") or small.mode == "F":
        levels = np.asarray(small, np.float64)
        small = Image.fromarray((levels * (255 / max(levels.max(), 255))).astype(np.uint8))
    small = small.convert("RGB")
    small.thumbnail((MOST_TEXELS, MOST_TEXELS), Image.Resampling.BOX)
    return linear_from_srgb(np.asarray(small, np.float32) / 255)


def _by_palette(vertices: np.ndarray, faces: np.ndarray, colours: np.ndarray, linear: bool) -> Painted:
    """A mesh with colours (F, 3), uint8, of its faces: each vertex once per colour that meets there."""
    row = Image.fromarray(np.ascontiguousarray(colours[None], np.uint8))
    reduced = row.quantize(_PALETTE, dither=Image.Dither.NONE)
    index = np.asarray(reduced)[0].astype(np.int64)
    palette = np.asarray(reduced.getpalette(), np.float64).reshape(-1, 3) / 255
    count = len(palette)
    corners, inverse = np.unique(faces * count + index[:, None], return_inverse=True)
    uv = np.stack([(corners % count + 0.5) / count, np.full(len(corners), 0.5)], axis=1)
    texture = _albedo((palette if linear else linear_from_srgb(palette))[None])
    return vertices[corners // count], inverse.reshape(-1, 3), uv.astype(np.float32), texture
