"""Colours of imported meshes as textures: linear albedo, at most 256 x 256 texels."""

import io
from dataclasses import dataclass

import numpy as np
from PIL import Image

from vig.scene import linear_from_srgb
from vig_world.assets.textures import BRIGHTEST, DARKEST

MAX_TEXELS = 256
MAX_PIXELS = 50_000_000  # most pixels of a picture, before it is reduced
GREY = 0.5  # albedo where a file has no readable colour


@dataclass(frozen=True, eq=False)
class Surface:
    """Statements of a file on a material.

    Attributes:
        colour: (3,) linear albedo, a factor of the picture where there is one.
        picture: (h, w, 3) linear albedo, or None.
        opacity: From 0 to 1; below 1 for glass.
        uv_scale, uv_offset: The picture lies at `uv * uv_scale + uv_offset`.
    """

    colour: np.ndarray
    picture: np.ndarray | None = None
    opacity: float = 1.0
    uv_scale: np.ndarray | float = 1.0
    uv_offset: np.ndarray | float = 0.0


@dataclass(frozen=True, eq=False)
class SurfaceMesh:
    """Triangles of one material.

    Attributes:
        vertices: (V, 3) float64.
        faces: (F, 3).
        uv: (V, 2), (0, 0) at the picture's bottom left; None where the file has none.
        surface: The material; None where the file has none.
        colours: (F, 3) uint8 of the faces, or None; a factor of the surface.
        linear: Whether the colours are linear light, not sRGB.
        names: Node of a scene behind those that it is below, or material of an OBJ file.
    """

    vertices: np.ndarray
    faces: np.ndarray
    uv: np.ndarray | None = None
    surface: Surface | None = None
    colours: np.ndarray | None = None
    linear: bool = False
    names: tuple[str, ...] = ()


Painted = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]
"""Vertices, faces, texture coordinates (V, 2) and texture (h, w, 3)."""


def paint(mesh: SurfaceMesh) -> list[Painted]:
    """Give a mesh one texture; or several, with its faces divided, where colours of faces tint a picture.

    A mesh coloured by face gets a palette for a texture, its vertices doubled between colours. A picture
    without texture coordinates counts by its mean colour.
    """
    surface, colours, uv = mesh.surface, mesh.colours, mesh.uv
    if surface is None:
        surface = Surface(np.full(3, GREY if colours is None else 1.0))
    texture = np.broadcast_to(surface.colour, (1, 1, 3)) * (
        1.0 if surface.picture is None else surface.picture
    )
    if surface.picture is None or uv is None or len(uv) != len(mesh.vertices):
        texture = texture.mean((0, 1), keepdims=True)
        uv = np.zeros((len(mesh.vertices), 2), np.float32)
    else:
        uv = np.asarray(uv)[:, :2] * surface.uv_scale + surface.uv_offset
        uv = np.nan_to_num(uv.astype(np.float32), posinf=0.0, neginf=0.0)
    if colours is None:
        return [(mesh.vertices, mesh.faces, uv, _albedo(texture))]
    # fewer colours where they tint a picture, as each needs a copy of it
    index, palette = _quantize(colours, 64 if texture.size == 3 else 8)
    tints = palette if mesh.linear else linear_from_srgb(palette)
    if texture.size == 3:
        vertices, faces, palette_uv = _by_palette(mesh.vertices, mesh.faces, index, len(palette))
        return [(vertices, faces, palette_uv, _albedo(texture * tints))]
    painted = []
    for number in np.unique(index):
        used, faces = np.unique(mesh.faces[index == number], return_inverse=True)
        painted.append(
            (mesh.vertices[used], faces.reshape(-1, 3), uv[used], _albedo(texture * tints[number]))
        )
    return painted


def colour_vertices(values: np.ndarray) -> np.ndarray:
    """Return colours (V, 3) as bytes; floats and doubles are fractions unless one is above 1."""
    if values.dtype.kind == "f":
        values = np.nan_to_num(values)
        values = 255 * values if values.size and values.max() <= 1 else values
    elif values.dtype.itemsize == 2:
        values = values / 257
    return np.clip(np.rint(values), 0, 255).astype(np.uint8)


def colour_faces(colours: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Return the colours (F, 3) of faces, as bytes, from those of vertices."""
    return colours[faces].mean(axis=1).astype(np.uint8)


class TooManyPixelsError(ValueError):
    """A picture is too large to be decoded."""


def open_picture(data: bytes) -> Image.Image:
    """Decode a picture. TooManyPixelsError, or any other exception for a damaged one."""
    image = Image.open(io.BytesIO(data))
    if image.width * image.height > MAX_PIXELS:
        raise TooManyPixelsError(f"a picture of {image.width} x {image.height} pixels")
    image.load()
    return image


def linear_picture(image: Image.Image) -> np.ndarray:
    """Return a picture as linear RGB, each side at most MAX_TEXELS."""
    small = image.convert("RGBA") if image.mode in ("P", "PA") else image
    if small.mode.startswith("I") or small.mode == "F":
        levels = np.asarray(small, np.float64)
        small = Image.fromarray((levels * (255 / max(levels.max(), 255))).astype(np.uint8))
    small = small.convert("RGB")
    small.thumbnail((MAX_TEXELS, MAX_TEXELS), Image.Resampling.BOX)
    return linear_from_srgb(np.asarray(small, np.float32) / 255)


def _albedo(values: np.ndarray) -> np.ndarray:
    return np.clip(values, DARKEST, BRIGHTEST).astype(np.float32)


def _quantize(colours: np.ndarray, most: int) -> tuple[np.ndarray, np.ndarray]:
    """Return numbers (F,) of colours (F, 3), uint8, in a palette, and the palette (n, 3), in [0, 1]."""
    row = Image.fromarray(np.ascontiguousarray(colours[None], np.uint8))
    reduced = row.quantize(most, dither=Image.Dither.NONE)
    palette = np.asarray(reduced.getpalette(), np.float64).reshape(-1, 3) / 255
    return np.asarray(reduced)[0].astype(np.int64), palette


def _by_palette(
    vertices: np.ndarray, faces: np.ndarray, index: np.ndarray, count: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return vertices, faces and uv: each vertex once per colour of `count` that meets there."""
    corners, inverse = np.unique(faces * count + index[:, None], return_inverse=True)
    uv = np.stack([(corners % count + 0.5) / count, np.full(len(corners), 0.5)], axis=1)
    return vertices[corners // count], inverse.reshape(-1, 3), uv.astype(np.float32)
