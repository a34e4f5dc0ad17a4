"""Other things of a drawn picture, behind the object or before it."""

import functools
import math

import numpy as np
from PIL import Image
from scipy import ndimage

from vig.scene import IMAGE_SIZE, linear_from_srgb
from vig_world import Split
from vig_world.assets.coats import any_colour
from vig_world.studio.cutouts import ModelCutouts, draw_cutout
from vig_world.studio.layers import Layer, draw_sheet, pixels

CUTOUT_SHARE = 0.8
"""Share of things that are cut-outs of solid objects; the others are flat shapes."""
REPAINTED_SHARE = 0.4
"""Share of these cut-outs whose surface is of one of the object's colours, of any other, or a texture."""
MODEL_SHARE = 0.6
"""Share of cut-outs that are of models in files, where there are such."""
MOTTLED_SHARE, MOTTLED_MODEL_SHARE = 0.4, 0.1
"""Shares of cut-outs with an uneven surface: among packaged props, and among models, which have textures."""
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
    size = max(place[2], 0.3)
    if rng.random() < CUTOUT_SHARE:
        middle = np.array(place[:2]) + rng.uniform(-1, 1, 2) * (0.6 if in_front else 1.0) * size
        reach = size * np.exp(rng.uniform(np.log(0.2), np.log(0.85 if in_front else 1.2)))
        layer = _draw_placed_cutout(rng, split, middle, reach, models)
        return _repaint(rng, layer, colours) if rng.random() < REPAINTED_SHARE else layer
    return _draw_flat(rng, colours, place, in_front)


def _draw_flat(
    rng: np.random.Generator, colours: list[np.ndarray], place: tuple[float, float, float], in_front: bool
) -> Layer:
    """Draw a flat shape, shaded as if it were round: a rod, a finger, a leaf, a cloth, a ring."""
    if in_front:
        middle = np.array(place[:2]) + rng.uniform(-0.6, 0.6, 2) * place[2]
        reach = place[2] * np.exp(rng.uniform(np.log(0.04), np.log(0.45), 2))
    else:
        middle = np.array(place[:2]) + rng.uniform(-1, 1, 2) * max(place[2], 0.3)
        reach = np.exp(rng.uniform(np.log(0.03), np.log(0.4), 2))
    angle = rng.uniform(0, math.pi)
    cos, sin = math.cos(angle), math.sin(angle)
    x, y = (each - offset for each, offset in zip(pixels(), middle, strict=True))
    along, across = cos * x + sin * y, cos * y - sin * x
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
    colour = _surface(rng, colours)
    normal = np.clip(across / reach[1], -1, 1)
    light = rng.uniform(0.5, 1.2) * (1 + rng.uniform(-0.7, 0.7) * normal - 0.4 * rng.random() * normal**2)
    shaded = np.broadcast_to(colour, (IMAGE_SIZE, IMAGE_SIZE, 3)) * np.clip(light, 0.05, 2)[..., None]
    if rng.random() < 0.2:
        glint = np.exp(-(((along / reach[0]) - 0.3) ** 2 + ((across / reach[1]) + 0.3) ** 2) / 0.02)
        shaded = shaded + rng.uniform(0.2, 1) * glint[..., None]
    return Layer(shaded.astype(np.float32), cover.astype(np.float32))


def occlude(
    rng: np.random.Generator,
    picture: np.ndarray,
    cover: np.ndarray,
    most_hidden: float,
    split: Split,
    colours: list[np.ndarray],
    place: tuple[float, float, float],
    models: ModelCutouts | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Put up to five things before an object; see `draw_thing`.

    Args:
        rng: Source of all randomness.
        picture: (H, W, 3) with the object.
        cover: (H, W) of the object.
        most_hidden: Share of it that is hidden, at most.
        split: Split of the things.
        colours: Colours that they may have.
        place: Middle and size of the object.
        models: In files, to be drawn as well.

    Returns:
        The picture, and the rest of the object's cover (H, W).
    """
    visible, full_area = cover, max(float(cover.sum()), 1e-6)
    target_share = 1 - rng.uniform(0, most_hidden)
    for _ in range(5):
        occluder = draw_thing(rng, split, colours, place, True, models)
        remaining = visible * (1 - occluder.cover)
        if remaining.sum() < (1 - most_hidden) * full_area:
            continue
        picture, visible = occluder.over(picture), remaining
        if visible.sum() < target_share * full_area:
            break
    return picture, visible


def draw_instead(
    rng: np.random.Generator, split: Split, name: str, vessel: bool, models: ModelCutouts | None = None
) -> Layer:
    """Draw a vessel, or any thing, that is not of the class of this name, in the middle of the picture.

    models: in files, to be drawn as well; they have none of the class.
    """
    middle, size = rng.normal(0, 0.04, 2), rng.uniform(0.5, 0.85)
    return _draw_placed_cutout(rng, split, middle, size, None if vessel else models, name, vessel)


def _draw_placed_cutout(
    rng: np.random.Generator,
    split: Split,
    middle: np.ndarray,
    size: float,
    models: ModelCutouts | None,
    unlike: str = "",
    lookalike: bool = False,
) -> Layer:
    """Draw a cut-out of a split's props, or of models, either way round, in some light, sometimes turned.

    Args:
        rng: Source of all randomness.
        split: Split of the props.
        middle: (2,) place of its middle, in widths from the picture's middle.
        size: Its longest side, in widths of the picture.
        models: Models in files, to be drawn as well.
        unlike: See `draw_cutout`.
        lookalike: See `draw_cutout`.
    """
    if models is not None and rng.random() < MODEL_SHARE:
        cutout, mottled = models.draw(rng), MOTTLED_MODEL_SHARE
    else:
        cutout, mottled = draw_cutout(rng, split, unlike, lookalike), MOTTLED_SHARE
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


def _repaint(rng: np.random.Generator, layer: Layer, colours: list[np.ndarray]) -> Layer:
    """Return the same thing, in its light and shade, with another surface: as fruit is before a pot."""
    shade = layer.colour.mean(2)
    brightness = float(np.average(shade, weights=layer.cover + 1e-6))
    gain = rng.uniform(0.5, 1.3) * shade / max(brightness, 1e-3)
    colour = _surface(rng, colours) * gain.clip(0, 3)[..., None]
    return Layer(colour.astype(np.float32), layer.cover)


def _surface(rng: np.random.Generator, colours: list[np.ndarray]) -> np.ndarray:
    """Return a flat texture (H, W, 3), or one of the given colours or another (3,), linear RGB."""
    if rng.random() < 0.35:
        return draw_sheet(rng)
    if rng.random() < 0.35:
        return colours[int(rng.integers(len(colours)))] * rng.uniform(0.7, 1.3)
    return any_colour(rng)
