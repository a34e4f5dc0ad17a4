"""Coats of objects: any colour, paint that follows the shape, glaze and metal."""

import colorsys
import functools

import numpy as np
from scipy.special import expit

from vig.scene import ShapeModel
from vig_world.asset_cache import Arrays, asset_cache
from vig_world.assets.textures import KINDS, decoration, texture
from vig_world.dataset.spec import Coat
from vig_world.mesh import face_normals

TEXTURES, DECORATIONS = 240, 120  # number of each
TEXTURE_SIZE = 96
DIELECTRIC = 0.04  # reflectance of glaze at normal incidence


@functools.lru_cache(maxsize=TEXTURES)
def stock_texture(number: int) -> np.ndarray:
    """Return a texture of anything: (S, S, 3) float32 linear albedo."""

    def made() -> Arrays:
        rng = np.random.default_rng(np.random.SeedSequence([number, 31]))
        base = any_colour(rng) if rng.random() < 0.5 else None
        return {"albedo": texture(list(KINDS)[number % len(KINDS)], rng, TEXTURE_SIZE, base)}

    return asset_cache().arrays(f"coat/texture/{number}", made)["albedo"]


@functools.lru_cache(maxsize=DECORATIONS)
def stock_decoration(number: int) -> np.ndarray:
    """Return a decoration for ceramics: (S, 2 S, 4) float32 linear albedo and coverage."""

    rng, name = np.random.default_rng(np.random.SeedSequence([number, 32])), f"coat/decoration/{number}"
    return asset_cache().arrays(name, lambda: {"paint": decoration(rng, TEXTURE_SIZE)})["paint"]


def any_colour(rng: np.random.Generator) -> np.ndarray:
    """Return linear RGB (3,) float32 of any thing: black, white, neutral, brown, pastel or saturated."""
    kind = rng.choice(6, p=[0.13, 0.19, 0.15, 0.13, 0.15, 0.25])
    if kind == 0:
        colour = rng.uniform(0.01, 0.06) * rng.uniform(0.8, 1.2, 3)
    elif kind == 1:
        colour = rng.uniform(0.6, 0.95) * rng.uniform(0.88, 1.0, 3)
    elif kind == 2:
        colour = np.exp(rng.uniform(np.log(0.05), np.log(0.6))) * rng.uniform(0.93, 1.07, 3)
    else:
        hue, saturation, value = rng.random(), rng.uniform(0.55, 1.0), rng.uniform(0.15, 1.0)
        if kind == 3:
            hue, saturation, value = rng.uniform(0.02, 0.11), rng.uniform(0.4, 0.9), rng.uniform(0.2, 0.75)
        elif kind == 4:
            saturation, value = rng.uniform(0.1, 0.45), rng.uniform(0.6, 1.0)
        colour = np.array(colorsys.hsv_to_rgb(hue, saturation, value)) ** 2.2
    return np.clip(colour, 0.008, 0.95).astype(np.float32)


def draw_coat(rng: np.random.Generator, parts: int, decorated: float, metal: float) -> Coat:
    """Return any coat for so many parts; a share `decorated` are painted, a share `metal` of metal."""
    colours = np.repeat(any_colour(rng)[None], parts, axis=0)
    if rng.random() < 0.25:
        other = any_colour(rng)
        colours[rng.random(parts) < rng.choice([0.2, 0.5])] = other
    shiny = bool(rng.random() < metal)
    colours = np.clip(colours * 1.5 + 0.15, 0, 0.95) if shiny else colours
    return Coat(
        tuple((float(r), float(g), float(b)) for r, g, b in colours),
        shiny,
        float(rng.choice([0.0, 0.5, 1.0], p=[0.35, 0.2, 0.45])),
        float(np.exp(rng.uniform(np.log(0.02), np.log(0.4)))),
        int(rng.integers(2**31)) if rng.random() < decorated and not shiny else None,
    )


def albedo_of(coat: Coat, points: np.ndarray, part: np.ndarray, height: float) -> np.ndarray:
    """Return albedo (N, 3) float32 at points (N, 3), metres, of parts (N,), of an object of this height."""
    albedo = np.array(coat.colours, np.float32).T.take(part, axis=1)  # a channel after the other: faster
    if coat.paint is None:
        return albedo.T
    rng = np.random.default_rng(coat.paint)
    around = np.arctan2(points[:, 1], points[:, 0]) / np.float32(2 * np.pi) + np.float32(rng.random())
    level = points[:, 2] / np.float32(height)
    everywhere = rng.random() < 0.4
    on = np.ones(len(part), bool) if everywhere else part <= 1
    for _ in range(rng.choice([1, 2, 3], p=[0.6, 0.3, 0.1])):
        paint, cover = draw_paint_layer(rng, around, level, points, height)
        albedo += (paint - albedo) * np.where(on, cover, np.float32(0))
    return albedo.T


def mean_albedo(coat: Coat, vertices: np.ndarray, model: ShapeModel) -> np.ndarray:
    """Return mean albedo (3,) over an object's surface (V, 3), metres, each vertex weighted by its share."""
    height = float(model.mean[:, 2].max())
    area = np.linalg.norm(face_normals(vertices, model.faces), axis=1)
    share = np.bincount(model.faces.ravel(), np.repeat(area, 3), minlength=len(vertices))
    return albedo_of(coat, vertices, model.parts, height).T @ (share / share.sum())


def draw_paint_layer(
    rng: np.random.Generator, around: np.ndarray, level: np.ndarray, points: np.ndarray, height: float
) -> tuple[np.ndarray, np.ndarray]:
    """Draw a layer of paint: colour (3, N) or (3, 1) and coverage (N,), float32.

    Args:
        rng: Source of all randomness.
        around: (N,) places about the vertical, in turns.
        level: (N,) places along it, in heights.
        points: (N, 3) the same places in space.
        height: Height of the object, in the units of points.
    """
    kind = rng.choice(7, p=[0.24, 0.18, 0.12, 0.12, 0.12, 0.12, 0.1])
    if kind == 0:  # painted ceramics
        image = stock_decoration(int(rng.integers(DECORATIONS)))
        paint = _look_up(image, around * float(rng.choice([1, 1, 2])), 1 - level)
        return paint[:3], paint[3]
    image = stock_texture(int(rng.integers(TEXTURES)))
    repeats = float(rng.choice([1, 2, 3, 5, 8]))
    paint = _look_up(image, around * 2 * repeats, -level * repeats)
    if kind == 1:  # a print all over
        return paint, np.ones(len(level), np.float32)
    if kind == 2:  # a motif on one side
        place, middle = (around - rng.random() + 0.5) % 1 - 0.5, level - rng.uniform(0.25, 0.6)
        size = rng.uniform(0.06, 0.22)
        reach = (np.abs(place) / size) ** 3 + (np.abs(middle) / (1.6 * size)) ** 3
        return paint if rng.random() < 0.7 else any_colour(rng)[:, None], (reach < 1).astype(np.float32)
    colour = paint if rng.random() < 0.25 else any_colour(rng)[:, None]
    if kind == 3:  # bands
        low = rng.uniform(-0.1, 0.9)
        return colour, ((level > low) & (level < low + rng.uniform(0.03, 0.5))).astype(np.float32)
    if kind == 4:  # stripes and checks
        count = int(rng.integers(3, 16))
        columns, rows = np.sin(2 * np.pi * count * around), np.sin(2 * np.pi * count * 0.45 * level)
        pattern = (columns, rows, columns * rows)[rng.integers(3)]
        return colour, (pattern > rng.uniform(-0.3, 0.5)).astype(np.float32)
    if kind == 5:  # dots
        count = int(rng.integers(3, 12))
        across, down = around * count, level * count * 0.45
        across = across + 0.5 * (np.floor(down) % 2)
        away = (across % 1 - 0.5) ** 2 + (down % 1 - 0.5) ** 2
        return colour, (away < rng.uniform(0.1, 0.45) ** 2).astype(np.float32)
    # blotches, as of a running glaze
    waves = (rng.normal(size=(5, 3)) * rng.uniform(1.5, 8) / height).astype(np.float32)
    value = np.sin(waves @ points.T + rng.uniform(0, 6.28, (5, 1)).astype(np.float32)).sum(0)
    return colour, expit(rng.uniform(2, 20) * (value - rng.uniform(-1, 1.5)))


def _look_up(image: np.ndarray, u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Return the nearest texels (C, N) of a repeating image (H, W, C), u right, v down, in its sizes."""
    height, width = image.shape[:2]
    row, column = (v * height).astype(np.int32) % height, (u * width).astype(np.int32) % width
    return image.reshape(height * width, -1).T.take(row * width + column, axis=1)
