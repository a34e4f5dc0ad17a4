"""Other things of a drawn picture, behind the object or before it."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from functools import partial

import numpy as np
from PIL import Image
from scipy import ndimage

from vig.scene import IMAGE_SIZE, linear_from_srgb
from vig_train.training.cutouts import ModelCutouts, draw_cutout
from vig_train.training.layers import Layer, draw_sheet, pixels
from vig_world import Split
from vig_world.assets.coats import TEXTURES, any_colour, stock_texture

CUTOUT_SHARE = 0.5
"""Share of things that are cut-outs of solid objects."""
REVOLVED_SHARE = 0.2
"""Share of things that are bodies of revolution."""
MODEL_SHARE = 0.6
"""Share of cut-outs that are of models in files, where there are such."""
MOTTLED_SHARE, MOTTLED_MODEL_SHARE = 0.4, 0.1
"""Shares of cut-outs with an uneven surface: among things by code, and among models, which have textures."""
NOISE_SIDE = 512
"""Side of the noise, pixels, from which uneven surfaces are cropped."""
_LINEAR = linear_from_srgb(np.arange(256) / 255).astype(np.float32)


def draw_thing(
    rng: np.random.Generator,
    split: Split,
    colours: list[np.ndarray],
    place: tuple[float, float, float],
    in_front: bool,
    models: ModelCutouts | None = None,
) -> Layer:
    """Draw something of a split near a place, in one of the given colours, in another, or textured.

    models: in files, to be drawn as well.
    """
    kind = rng.random()
    if kind < CUTOUT_SHARE:
        if models is not None and rng.random() < MODEL_SHARE:
            layer = _cutout(rng, partial(models.draw, rng), place, in_front, MOTTLED_MODEL_SHARE)
            # Some are in a colour of the object, as fruit is before a pot.
            return _tinted(rng, layer, colours) if rng.random() < 0.3 else layer
        return _cutout(rng, partial(draw_cutout, rng, split), place, in_front)
    if kind < CUTOUT_SHARE + REVOLVED_SHARE:
        return _revolved(rng, colours, place, in_front)
    # A tenth has several round parts; all others are flat shapes, shaded as if they were round.
    if kind < CUTOUT_SHARE + REVOLVED_SHARE + 0.1:
        return _figure(rng, colours, place, in_front)
    angle = rng.uniform(0, math.pi)
    if in_front:
        middle = np.array(place[:2]) + rng.uniform(-0.6, 0.6, 2) * place[2]
        reach = place[2] * np.exp(rng.uniform(np.log(0.04), np.log(0.45), 2))
    else:
        middle = np.array(place[:2]) + rng.uniform(-1, 1, 2) * np.maximum(place[2], 0.3)
        reach = np.exp(rng.uniform(np.log(0.03), np.log(0.4), 2))
    along, across = _turned(middle, angle)
    if rng.random() < 0.3:  # a rod, a finger, a stalk
        reach = np.array([rng.uniform(0.15, 0.9), rng.uniform(0.01, 0.06)])
    across = across + rng.normal(0, 0.3) * along**2
    p, q = np.abs(along) / reach[0], np.abs(across) / reach[1]
    power = rng.choice([1.3, 2.0, 2.0, 6.0, 12.0])
    radius = (p**power + q**power) ** (1 / power)
    if rng.random() < 0.35:  # an uneven outline, as of leaves or cloth
        turn = np.arctan2(across / reach[1], along / reach[0])
        radius = radius * (
            1 + rng.uniform(0.05, 0.3) * np.sin(int(rng.integers(2, 9)) * turn + rng.uniform(0, 6))
        )
    soft = IMAGE_SIZE * min(reach) * rng.choice([1.0, 1.0, 0.4])
    cover = np.clip(0.5 + (1 - radius) * soft, 0, 1)
    if rng.random() < 0.12:  # a ring or a handle
        cover = cover * np.clip(0.5 + (radius - rng.uniform(0.5, 0.85)) * soft, 0, 1)
    colour = draw_sheet(rng) if rng.random() < 0.35 else _colour(rng, colours)
    normal = np.clip(across / reach[1], -1, 1)
    light = rng.uniform(0.5, 1.2) * (1 + rng.uniform(-0.7, 0.7) * normal - 0.4 * rng.random() * normal**2)
    shaded = np.broadcast_to(colour, (IMAGE_SIZE, IMAGE_SIZE, 3)) * np.clip(light, 0.05, 2)[..., None]
    if rng.random() < 0.2:
        glint = np.exp(-(((along / reach[0]) - 0.3) ** 2 + ((across / reach[1]) + 0.3) ** 2) / 0.02)
        shaded = shaded + rng.uniform(0.2, 1) * glint[..., None]
    return Layer(shaded.astype(np.float32), cover.astype(np.float32))


def draw_instead(
    rng: np.random.Generator, split: Split, name: str, vessel: bool, models: ModelCutouts | None = None
) -> Layer:
    """Draw a vessel, or any thing, that is not of the class of this name, in the middle of the picture.

    models: in files, to be drawn as well; they have none of the class.
    """
    middle, size = rng.normal(0, 0.04, 2), rng.uniform(0.5, 0.85)
    if not vessel and models is not None and rng.random() < MODEL_SHARE:
        return _place_cutout(rng, models.draw(rng), middle, size, MOTTLED_MODEL_SHARE)
    return _place_cutout(rng, draw_cutout(rng, split, name, vessel), middle, size)


def _cutout(
    rng: np.random.Generator,
    draw: Callable[[], Image.Image],
    place: tuple[float, float, float],
    in_front: bool,
    mottled: float = MOTTLED_SHARE,
) -> Layer:
    """Place a cut-out that `draw` gives, near a place."""
    size = max(place[2], 0.3)
    middle = np.array(place[:2]) + rng.uniform(-1, 1, 2) * (0.6 if in_front else 1.0) * size
    reach = size * np.exp(rng.uniform(np.log(0.2), np.log(0.85 if in_front else 1.2)))
    return _place_cutout(rng, draw(), middle, reach, mottled)


def _tinted(rng: np.random.Generator, layer: Layer, colours: list[np.ndarray]) -> Layer:
    """Return the same thing, its mean colour moved towards one of the given colours."""
    if not layer.cover.any():
        return layer
    mean = np.average(layer.colour.reshape(-1, 3), axis=0, weights=layer.cover.ravel())
    tint = (colours[int(rng.integers(len(colours)))] + 0.02) / (mean + 0.02)
    return Layer((layer.colour * tint ** rng.uniform(0.5, 1)).astype(np.float32), layer.cover)


def _place_cutout(
    rng: np.random.Generator,
    cutout: Image.Image,
    middle: np.ndarray,
    size: float,
    mottled: float = MOTTLED_SHARE,
) -> Layer:
    """Place a cut-out, either way round, in some light, sometimes turned.

    Args:
        rng: Source of all randomness.
        cutout: RGBA, sRGB.
        middle: (2,) place of its middle, in widths from the picture's middle.
        size: Its longest side, in widths of the picture.
        mottled: Share of cut-outs with an uneven surface.
    """
    longest_side = max(cutout.size)
    angle = float(rng.normal(0, 8) if rng.random() < 0.9 else rng.uniform(0, 360))
    if rng.random() < 0.5:
        cutout = cutout.transpose(Image.Transpose.FLIP_LEFT_RIGHT)
    if abs(angle) > 1:
        cutout = cutout.rotate(angle, Image.Resampling.BILINEAR, expand=True)
    factor = size * IMAGE_SIZE / longest_side
    shape = [max(1, round(length * factor)) for length in cutout.size]
    corner = [
        round((0.5 + float(offset)) * IMAGE_SIZE - length / 2)
        for offset, length in zip(middle, shape, strict=True)
    ]
    canvas = Image.new("RGBA", (IMAGE_SIZE, IMAGE_SIZE))
    canvas.paste(cutout.resize((shape[0], shape[1]), Image.Resampling.BILINEAR), (corner[0], corner[1]))
    picture = np.asarray(canvas)
    gain = np.exp(rng.normal(0, 0.25)) * np.exp(rng.normal(0, 0.05, 3))
    colour = _LINEAR[picture[..., :3]] * gain.astype(np.float32)
    if rng.random() < mottled:
        colour = colour * _mottle(rng)
    return Layer(colour, picture[..., 3] / np.float32(255))


def _mottle(rng: np.random.Generator) -> np.ndarray:
    """Draw uneven wear, cloth, fur, reflections: a gain (H, W, 3), patchy at any of several scales."""
    strength, tint = rng.uniform(0.1, 0.7), rng.normal(0, 0.35, 3)
    offset = rng.integers(NOISE_SIDE - IMAGE_SIZE, size=2)
    patches = _patches(int(rng.integers(4)))[offset[0] :, offset[1] :][:IMAGE_SIZE, :IMAGE_SIZE, None]
    return np.exp(strength * patches * (1 + tint)).astype(np.float32)


@functools.cache
def _patches(scale: int) -> np.ndarray:
    """Return smooth noise (S, S) of unit variance, of waves from a few pixels on to twenty."""
    rng = np.random.default_rng(scale)
    noise = sum(
        blur * ndimage.gaussian_filter(rng.normal(size=(NOISE_SIDE, NOISE_SIDE)), blur, mode="wrap")
        for blur in np.array([0.7, 2.0, 5.0]) * 1.5**scale
    )
    return (noise / noise.std()).astype(np.float32)


def _revolved(
    rng: np.random.Generator, colours: list[np.ndarray], place: tuple[float, float, float], in_front: bool
) -> Layer:
    """Draw a bottle, jar, fruit, cup, candle or the like, seen from a little above, standing or lying."""
    reach = max(place[2], 0.3) * np.exp(rng.uniform(np.log(0.1), np.log(0.5)))
    spread = 0.55 * place[2] if in_front else 1.0 * max(place[2], 0.3)
    middle = np.array(place[:2]) + rng.uniform(-1, 1, 2) * spread
    angle = rng.normal(0, 0.15) if rng.random() < 0.6 else rng.uniform(0, 2 * math.pi)
    across, down = _turned(middle, angle)
    across, up = across / reach, -down / reach
    heights = np.linspace(-1, 1, 65)
    knots = np.exp(rng.normal(0, rng.choice([0.02, 0.3]), 6))
    ends = (1 - np.abs(heights) ** rng.choice([2.0, 2.5, 8.0, 40.0])).clip(0) ** 0.5
    bend = np.interp(heights, np.linspace(-1, 1, 6), knots)
    radii = np.exp(rng.uniform(np.log(0.12), np.log(1.1))) * np.convolve(
        np.pad(bend, 6, mode="edge"), np.full(13, 1 / 13), "valid"
    )
    radii = radii * ends
    tilt = rng.uniform(0, 0.5)
    widest = float(radii.max())
    # Seen from above, nearer points lie lower in the picture.
    height = up + tilt * np.sqrt((widest**2 - across**2).clip(0))
    radius = np.interp(height, heights, radii, left=0, right=0)
    soft = IMAGE_SIZE * reach
    cover = np.clip(0.5 + (radius - np.abs(across)) * soft, 0, 1) * (radius > 0)
    sideways = np.clip(across / np.maximum(radius, 1e-3), -1, 1)
    slope = np.interp(height, heights, np.gradient(radii, heights)).clip(-3, 3)
    normal = np.stack([sideways, -slope, np.sqrt(1 - sideways**2)], -1)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    colour = np.broadcast_to(_colour(rng, colours), (IMAGE_SIZE, IMAGE_SIZE, 3))
    if rng.random() < 0.6:  # a label, a print or a band of another colour
        around = np.arcsin(sideways) / math.pi + rng.random()
        image = stock_texture(int(rng.integers(TEXTURES)))
        side, repeats = len(image), rng.choice([0.5, 1, 2, 4])
        row, column = ((share * repeats * side).astype(int) % side for share in (-height, around))
        low = rng.uniform(-1.2, 0.8)
        in_band = (height > low) & (height < low + rng.uniform(0.2, 2.0))
        colour = np.where(
            in_band[..., None], image[row, column] if rng.random() < 0.6 else any_colour(rng), colour
        )
    light = rng.normal(size=3) + [0, 0.8, 0.8]
    light /= np.linalg.norm(light)
    shading = normal @ light
    shaded = colour * (rng.uniform(0.2, 0.6) + rng.uniform(0.3, 0.9) * shading.clip(0))[..., None]
    if rng.random() < 0.5:
        half_vector = light + [0, 0, 1]
        shine = (normal @ (half_vector / np.linalg.norm(half_vector))).clip(0) ** np.exp(rng.uniform(2, 6))
        shaded = shaded + rng.uniform(0.1, 0.9) * shine[..., None]
    rim = float(radii[-4])
    if rim > 0.3 * widest and tilt > 0.08:  # an open or flat top
        top = (across / rim) ** 2 + ((up - 0.9) / (tilt * rim)) ** 2
        inside = np.clip(0.5 + (1 - top) * 0.5 * soft * tilt * rim, 0, 1)
        shaded = np.where(top[..., None] < 1, shaded.mean((0, 1)) * rng.uniform(0.3, 1.5), shaded)
        cover = np.maximum(cover, inside)
    return Layer(shaded.astype(np.float32), cover.astype(np.float32))


def _figure(
    rng: np.random.Generator, colours: list[np.ndarray], place: tuple[float, float, float], in_front: bool
) -> Layer:
    """Draw an animal, a toy, a plant, a crumpled cloth: round parts that run into each other."""
    x, y = pixels()
    size = max(place[2], 0.3)
    reach = size * np.exp(rng.uniform(np.log(0.12), np.log(0.5)))
    middle = np.array(place[:2]) + rng.uniform(-1, 1, 2) * (0.55 if in_front else 1.0) * size
    level = np.full(x.shape, -np.inf, np.float32)
    paints, palette = [], [any_colour(rng) for _ in range(3)]
    for part in range(int(rng.integers(3, 9))):
        angle = rng.uniform(0, math.pi)
        radii = reach * np.exp(rng.uniform(np.log(0.15), np.log(0.6), 2)) * (1 if part else 1.6)
        centre = middle + (reach * rng.normal(0, 0.55, 2) if part else 0.0)
        along, across = _turned(centre, angle)
        part_level = (1 - (along / radii[0]) ** 2 - (across / radii[1]) ** 2) * min(radii)
        paints.append((part_level > level, palette[int(rng.integers(3))]))
        level = np.maximum(level, part_level)
    cover = np.clip(0.5 + level * IMAGE_SIZE * 0.7, 0, 1)
    single_colour = rng.random() < 0.5
    base = _colour(rng, colours) if single_colour else draw_sheet(rng)
    colour = np.broadcast_to(base, (*x.shape, 3)).copy()
    if rng.random() < 0.5:  # each part in a colour of its own
        for region, paint in paints:
            colour[region] = paint
    if rng.random() < 0.4:  # spotted
        waves = rng.normal(size=(6, 2)) * rng.uniform(2, 10) / reach
        value = sum(np.sin(wave[0] * x + wave[1] * y + rng.uniform(0, 6.28)) for wave in waves)
        colour[value > rng.uniform(-0.5, 2)] = any_colour(rng)
    height = ndimage.gaussian_filter(np.sqrt(np.maximum(level, 0) * min(reach, 0.2)), 1.0)
    slope_y, slope_x = np.gradient(height * IMAGE_SIZE)
    normal = np.stack([-slope_x, -slope_y, np.ones_like(slope_x)], -1)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    light = rng.normal(size=3) + [0, -0.8, 0.8]
    shading = (normal @ (light / np.linalg.norm(light))).clip(0)
    shaded = colour * (rng.uniform(0.2, 0.6) + rng.uniform(0.3, 0.9) * shading)[..., None]
    return Layer(shaded.astype(np.float32), cover.astype(np.float32))


def _turned(middle: np.ndarray, angle: float) -> tuple[np.ndarray, np.ndarray]:
    """Return coordinates (H, W) of pixels about a middle, in axes turned clockwise by an angle, radians."""
    x, y = (each - offset for each, offset in zip(pixels(), middle, strict=True))
    cos, sin = math.cos(angle), math.sin(angle)
    return cos * x + sin * y, cos * y - sin * x


def _colour(rng: np.random.Generator, colours: list[np.ndarray]) -> np.ndarray:
    """Return one of the given colours, or another: linear RGB (3,)."""
    if rng.random() < 0.35:
        return colours[int(rng.integers(len(colours)))] * rng.uniform(0.7, 1.3)
    return any_colour(rng)
