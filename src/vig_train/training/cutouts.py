"""Cut-outs of solid things, to put pictures together from: the packaged props, in any pose and light."""

from __future__ import annotations

import functools
import hashlib
import math
from pathlib import Path

import numpy as np
from PIL import Image

from vig.scene import Camera, linear_from_srgb, srgb_from_linear
from vig_world import SPLITS, Split
from vig_world.asset_cache import asset_cache
from vig_world.assets.models import packaged_props, vary
from vig_world.assets.things import Prop, is_of_class
from vig_world.mesh import vertex_normals
from vig_world.raster.rasterize import rasterize

CUTOUTS_PER_SPLIT = 1600
"""Cut-outs of each kind, any and lookalike, that a split has."""
SUPERSAMPLING = 2
"""Rendered points across each pixel."""
FREQUENT = {"animal": 0.2, "model_car": 0.1}
"""Shares of cut-outs that are of these families; all others are as frequent as each other."""
LOOKALIKES = (
    "basket", "bottle", "bowl", "coffee_press", "creamer", "cup", "glass", "jar", "kettle", "mug", "sugar",
    "teapot", "tumbler", "utensils", "vase",
)  # fmt: skip
"""Families of props that share something with vessels that pour, where a split has them."""


def draw_cutout(rng: np.random.Generator, split: Split) -> Image.Image:
    """Draw one of a split's things: RGBA, sRGB, as large as its outline."""
    return _numbered_cutout(_first(split) + int(rng.integers(CUTOUTS_PER_SPLIT)), False)


def draw_other(rng: np.random.Generator, split: Split, name: str) -> Image.Image:
    """Draw one of a split's things that are not of the class of this name; see `draw_cutout`."""
    return _numbered_cutout(_unlike(rng, split, name, False), False)


def draw_vessel(rng: np.random.Generator, split: Split, name: str) -> Image.Image:
    """Draw one of a split's vessels that are not of the class of this name; see `draw_cutout`."""
    return _numbered_cutout(_unlike(rng, split, name, True), True)


def _first(split: Split) -> int:
    """Return the number of a split's first cut-out."""
    return CUTOUTS_PER_SPLIT * SPLITS.index(split)


def _unlike(rng: np.random.Generator, split: Split, name: str, lookalike: bool) -> int:
    """Draw a random number of a split's cut-outs whose family is not like a class."""
    number = int(rng.integers(CUTOUTS_PER_SPLIT))
    while is_of_class(_family_of(_first(split) + number, lookalike), name):
        number = (number + 1) % CUTOUTS_PER_SPLIT
    return _first(split) + number


@functools.lru_cache(maxsize=2 * CUTOUTS_PER_SPLIT)
def _numbered_cutout(number: int, lookalike: bool) -> Image.Image:
    """Return the cut-out of a number, made at most once on a machine: it takes a hundredth of a second."""
    name = f"{_code()}/{'lookalike' if lookalike else 'any'}/{number}"
    made = asset_cache().arrays(name, lambda: {"rgba": np.asarray(_make_cutout(number, lookalike))})
    return Image.fromarray(made["rgba"])


@functools.cache
def _code() -> str:
    """Return the name under which this file's cut-outs are kept."""
    return f"cutouts-{hashlib.sha256(Path(__file__).read_bytes()).hexdigest()[:8]}"


def _make_cutout(number: int, lookalike: bool) -> Image.Image:
    """Make a prop in random proportions, colours, pose and light."""
    rng, family = _stream(number, lookalike), _family_of(number, lookalike)
    models = packaged_props(SPLITS[number // CUTOUTS_PER_SPLIT])[family]
    model = models[int(rng.integers(len(models)))]
    shown = Prop(family, vary(model.read(), rng))
    fallen = rng.random() < 0.12 and not lookalike
    return render_cutout(rng, shown, rng.uniform(0, 2 * math.pi) if fallen else 0.0)


def _stream(number: int, lookalike: bool, purpose: int = 0) -> np.random.Generator:
    return np.random.default_rng(np.random.SeedSequence([number, 33, int(lookalike), purpose]))


def _family_of(number: int, lookalike: bool = False) -> str:
    """Return the family of the thing of a number."""
    families = tuple(packaged_props(SPLITS[number // CUTOUTS_PER_SPLIT]))
    if lookalike:
        families = tuple(family for family in LOOKALIKES if family in families)
    else:
        kind = float(_stream(number, False, 1).random())
        for family, share in FREQUENT.items():
            if kind < share:
                return family
            kind -= share
    return families[number % len(families)]


def place_cutout(
    cutout: Image.Image, middle: tuple[float, float], size: float, angle: float, side: int
) -> np.ndarray:
    """Put a cut-out into an empty picture: (side, side, 4) linear RGB, not multiplied, and coverage.

    Args:
        cutout: RGBA.
        middle: Place of its middle, in widths from the picture's middle.
        size: Its longest side, in widths of the picture.
        angle: Degrees by which it is turned, counter-clockwise.
        side: Side of the picture, pixels.
    """
    rotated = cutout.rotate(angle, Image.Resampling.BILINEAR, expand=True) if abs(angle) > 1 else cutout
    factor = size * side / max(cutout.size)
    shape = (max(1, round(rotated.width * factor)), max(1, round(rotated.height * factor)))
    rotated = rotated.resize(shape, Image.Resampling.BILINEAR)
    canvas = Image.new("RGBA", (side, side))
    left, top = (
        round((0.5 + offset) * side - length / 2) for offset, length in zip(middle, shape, strict=True)
    )
    canvas.paste(rotated, (left, top))
    pixels = np.asarray(canvas)
    return np.concatenate([_LINEAR[pixels[..., :3]], pixels[..., 3:] / np.float32(255)], axis=2)


_LINEAR = linear_from_srgb(np.arange(256) / 255).astype(np.float32)


def render_cutout(rng: np.random.Generator, shown_prop: Prop, roll: float) -> Image.Image:
    """Draw a thing, turned at random about the vertical: RGBA, sRGB, as large as its outline.

    roll: the camera's, radians.
    """
    meshes = [mesh for mesh, _ in shown_prop.parts]
    points = np.concatenate([mesh.vertices for mesh in meshes])
    starts = np.cumsum([0] + [len(mesh.vertices) for mesh in meshes])
    faces = np.concatenate([mesh.faces + start for mesh, start in zip(meshes, starts, strict=False)])
    owner = np.repeat(np.arange(len(meshes)), [len(mesh.faces) for mesh in meshes])
    points = points - (points.min(0) + points.max(0)) / 2
    reach = float(np.linalg.norm(points, axis=1).max())
    # A cut-out is drawn in a picture of 112 pixels.
    size = 112 * SUPERSAMPLING
    camera = Camera(size, size, 1.9 * size, size / 2, size / 2, 4.0 * reach, roll=roll)
    from_above = rng.random() < 0.25
    matrix = camera.camera_from_world(
        rng.uniform(0, 2 * math.pi), math.radians(rng.uniform(30, 85) if from_above else rng.uniform(-5, 30))
    )
    rotation = matrix[:3, :3]
    fragments = rasterize(points, faces, rotation, matrix[:3, 3], camera)
    covered = fragments.face >= 0
    face, weights = fragments.face[covered], fragments.barycentric[covered]
    normals = np.concatenate([vertex_normals(mesh.vertices, mesh.faces) for mesh in meshes])
    uv = np.concatenate([np.zeros((len(m.vertices), 2)) if m.uv is None else m.uv for m in meshes])
    attributes = np.concatenate([normals @ rotation.T, uv], axis=1)
    interpolated = np.add.reduce([weights[:, c, None] * attributes[faces[face, c]] for c in range(3)])
    normal = interpolated[:, :3] / (np.linalg.norm(interpolated[:, :3], axis=1, keepdims=True) + 1e-9)
    normal = np.where(normal[:, 2:] > 0, -normal, normal)
    colour = np.empty((len(face), 3), np.float32)
    shine = np.zeros((len(face), 1))
    for number, (_, surface) in enumerate(shown_prop.parts):
        of_part = owner[face] == number
        height, width = surface.texture.shape[:2]
        u, v = interpolated[of_part, 3], 1 - interpolated[of_part, 4]
        colour[of_part] = surface.texture[(v * height).astype(int) % height, (u * width).astype(int) % width]
        shine[of_part] = 0.7 * (1 - surface.roughness) ** 2
    light = rng.normal(size=3) + [0, -0.9, -0.9]
    light /= np.linalg.norm(light)
    half_vector = light - [0, 0, 1]
    half_vector /= np.linalg.norm(half_vector)
    shading = (
        rng.uniform(0.2, 0.6) * (0.75 - 0.25 * normal[:, 1:2])
        + rng.uniform(0.3, 0.9) * (normal @ light).clip(0)[:, None]
    )
    specular = (normal @ half_vector).clip(0)[:, None] ** np.exp(rng.uniform(2, 5.5))
    picture = np.zeros((size, size, 4), np.float32)
    picture[covered] = np.concatenate([colour * shading + shine * specular, np.ones_like(specular)], axis=1)
    parts = [
        picture[i::SUPERSAMPLING, j::SUPERSAMPLING]
        for i in range(SUPERSAMPLING)
        for j in range(SUPERSAMPLING)
    ]
    mean = np.add.reduce(parts) / len(parts)
    display = srgb_from_linear((mean[..., :3] / np.maximum(mean[..., 3:], 1e-6)).clip(0, 1))
    image = Image.fromarray((np.concatenate([display, mean[..., 3:]], axis=2) * 255).round().astype(np.uint8))
    return image.crop(image.getchannel("A").getbbox() or (0, 0, 1, 1))
