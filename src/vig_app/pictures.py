"""Pictures of explanations: outlines on the photo, and the fit beside it."""

import functools
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar
from weakref import WeakKeyDictionary

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from vig.explanation import Explanation
from vig.parallel import on_one_core
from vig.photo import Window
from vig.photo.filters import erosion
from vig.photo.images import as_srgb
from vig.photo.outline import FINER, line_reach, line_width
from vig.renderer.drawing import draw_latents
from vig.scene import Camera
from vig.scene.light import srgb_from_linear
from vig.several.scene import SceneExplanation

Made = TypeVar("Made")
OUTLINE = np.array([255, 210, 0], np.float32)
"""Colour of outlines, 8-bit sRGB; `HIDDEN` is that of hidden pixels, mixed in by `HIDDEN_SHARE`."""
BORDER = np.array([20, 20, 20], np.float32)
"""Colour next to the outline, so that it shows on bright and yellow ground, too."""
HIDDEN = np.array([235, 40, 120], np.float32)
HIDDEN_SHARE = 0.5
PANEL = 300  # pixels a side of the pictures in `draw_panels`
LABEL = 22  # pixels of the line above each with its name
MIN_PIXELS = 30  # visible pixels from which a part's own colour is estimated
WHITE, BRIGHT, DARK = np.float32(255), np.float32(217), np.float32(38)
"""8-bit levels of `draw_panels`, those of visible pixels in the mask, and of grounds."""
RESIDUAL_COLOURS = np.array([[0.80, 0.10, 0.10], [0.10, 0.25, 0.80]], np.float32)
"""Colours where the photo is brighter, and where it is darker."""
TINT = 0.2  # share of an object's colour in its tint
COLOURS = np.array([(255, 220, 0), (0, 220, 255), (255, 90, 220), (120, 255, 90)], np.float32)
"""Colours of the tints of several objects, in turn."""


def once(make: Callable[[Explanation], Made]) -> Callable[[Explanation], Made]:
    """Keep a function's result for an explanation for as long as the explanation is there."""
    made: WeakKeyDictionary[Explanation, Made] = WeakKeyDictionary()

    @functools.wraps(make)
    def kept(explanation: Explanation) -> Made:
        if explanation not in made:
            made[explanation] = make(explanation)
        return made[explanation]

    return kept


def overlay(explanation: Explanation, photo: np.ndarray | None = None) -> np.ndarray:
    """Draw `Explanation.overlay`.

    photo: Its photo (h, w, 3) uint8 made smaller, `SMALLEST_PICTURE` pixels or more; by default as it is.
    """
    photo = as_srgb(explanation.picture) if photo is None else photo
    window = explanation.window.scale(photo.shape[1] / explanation.picture.shape[1])
    return draw_outlines(photo, window, *explanation.outlines)


def scene_overlay(scene: SceneExplanation) -> np.ndarray:
    """Draw `SceneExplanation.overlay`."""
    picture = as_srgb(scene.objects[0].picture).astype(np.float32)
    width = max(1, round(max(picture.shape) / 500))
    for number, each in enumerate(scene.objects):
        colour = COLOURS[number % len(COLOURS)]
        picture[each.mask] += TINT * (colour - picture[each.mask])
        picture[each.amodal & ~erosion(each.amodal, width)] = colour
    return np.rint(picture).astype(np.uint8)


def draw_outlines(photo: np.ndarray, window: Window, covered: np.ndarray, visible: np.ndarray) -> np.ndarray:
    """Return the photo with the object's whole outline in yellow and its hidden pixels tinted pink.

    The outline is smooth, between dark lines, and lies beside the covered pixels; it widens with the photo.

    Args:
        photo: (H, W, 3) uint8 sRGB.
        window: Window that was fitted.
        covered: Distance to the outline of the covered pixels, see `vig.photo.outline_distance`.
        visible: The same for the visible pixels.

    Returns:
        (H, W, 3) uint8.
    """
    picture = photo.copy()
    height, width = photo.shape[:2]
    line, scale = line_width(height, width), window.side * FINER / len(covered)
    border, nowhere = max(1.0, line / 2), float(covered.max())
    for tile in window.tiles(width, height, around=covered < nowhere):
        outer = scale * window.paste(covered, *tile, outside=nowhere)
        inner = scale * window.paste(visible, *tile, outside=nowhere)
        near = outer < min(line_reach(height, width), 0.999 * scale * nowhere)
        touched = np.nonzero(near & ((outer > -0.5) | (inner > -0.5)))
        outer, inner = outer[touched], inner[touched]
        hidden = HIDDEN_SHARE * _share(-outer) * _share(inner)
        middle = np.abs(outer - border - line / 2)
        colours = picture[tile][touched].astype(np.float32)
        dark, bright = _share(line / 2 + border - middle), _share(line / 2 - middle)
        for share, colour in ((hidden, HIDDEN), (dark, BORDER), (bright, OUTLINE)):
            colours += share[:, None] * (colour - colours)
        picture[tile][touched] = colours.round()
    return picture


@dataclass(frozen=True)
class CloseUp:
    """An explained window of S x S pixels, upright, beside its re-rendering.

    Attributes:
        photo: (S, S, 3) linear RGB.
        rendering: (S, S, 3) linear RGB, the explained object in front of black.
        coverage: (S, S) share of each pixel that it covers.
        normals: (S, S, 3) unit, in camera axes (x right, y down, z forward); 0 where nothing is.
        part: (S, S) int, the object's part, -1 where nothing is.
        depth: (S, S) metres along the optical axis, inf where nothing is.
        visible: (S, S) bool, where nothing hides it.
        camera: Camera of the rendering.
    """

    photo: np.ndarray
    rendering: np.ndarray
    coverage: np.ndarray
    normals: np.ndarray
    part: np.ndarray
    depth: np.ndarray
    visible: np.ndarray
    camera: Camera


@once
def close_up(explanation: Explanation) -> CloseUp:
    """Draw the window of an explanation in `PANEL` pixels a side."""
    object_class, latents = explanation.object_class, explanation.latents
    camera = explanation.window_camera
    camera = camera.scale(PANEL / camera.width)
    drawn = on_one_core(functools.partial(draw_latents, latents, object_class, camera))
    pose = camera.camera_from_object(latents)
    model, triangle = object_class.shape_model, drawn.triangle_id
    everything = slice(0, PANEL), slice(0, PANEL)
    window, picture = explanation.window, explanation.picture
    if (coarser := int(window.side / (2 * PANEL))) > 1:  # as much of a large photo's detail as shows
        window = window.scale(1 / coarser)
        picture = np.asarray(Image.fromarray(as_srgb(picture)).reduce(coarser))
    return CloseUp(
        photo=window.crop(picture, PANEL)[0],
        rendering=drawn.rgb,
        coverage=drawn.coverage,
        normals=drawn.normals @ pose[:3, :3].T.astype(np.float32),
        part=np.where(triangle < 0, -1, model.parts[model.faces[triangle, 0]]),
        depth=drawn.depth,
        visible=Window(0, 0, PANEL).paste(explanation.outlines[1], *everything) < 0,
        camera=camera,
    )


def others_in_window(explanation: Explanation, size: int) -> np.ndarray:
    """Return the share (size, size) of each pixel of the window in which other objects are visible."""
    assert explanation.others is not None
    white = explanation.others.view(np.uint8) * np.uint8(255)
    return explanation.window.crop(np.broadcast_to(white[..., None], (*white.shape, 3)), size)[0][..., 0]


@once
def panels(explanation: Explanation) -> np.ndarray:
    """Draw `Explanation.panels`."""
    return draw_panels(close_up(explanation))


@once
def part_albedo(explanation: Explanation) -> np.ndarray:
    """Return linear RGB (parts, 3) of the surface of each part, see `part_colours`."""
    reflectance = explanation.object_class.reflectance_of_parts
    return part_colours(close_up(explanation), explanation.latents.albedo[0], reflectance)


def draw_panels(shown: CloseUp) -> np.ndarray:
    """Return photo, re-rendering, residual, normals and mask under their names: (S + label, 5 S, 3) uint8.

    The re-rendering stands in the photo, in front of everything. The residual is the photo's brightness less
    the rendering's where the object is visible: red where the photo is brighter, blue where it is darker.
    Normals are coloured by direction: red to the right, green up, blue towards the camera. The mask is white
    where the object is visible, pink where it is hidden.
    """
    size = len(shown.photo)
    photo = 255 * srgb_from_linear(shown.photo.reshape(-1, 3))
    here = np.flatnonzero(shown.visible | (shown.coverage > 0))
    share, seen = (each.reshape(-1, 1)[here] for each in (shown.coverage, shown.visible))
    rendering, normals, behind = (
        each.reshape(-1, 3)[here] for each in (shown.rendering, shown.normals, photo)
    )
    # Both encoded before they are mixed, as screens would.
    drawn = 255 * srgb_from_linear(rendering / np.maximum(share, 1e-6))
    # 0.5: difference of sRGB brightness, of 1, that is drawn in full colour
    difference = (behind - drawn).mean(-1, keepdims=True) / (255 * 0.5)
    towards = np.where(difference > 0, RESIDUAL_COLOURS[:1], RESIDUAL_COLOURS[1:])
    residual = WHITE + np.abs(difference).clip(0, 1) * WHITE * (towards - 1)
    normals = WHITE / 2 + WHITE / 2 * normals * np.array([1, -1, -1], np.float32)
    pictures: tuple[tuple[np.ndarray | np.float32, np.ndarray], ...] = (  # where it is not, and where it is
        (photo, behind),
        (photo, behind + share * (drawn - behind)),
        (BRIGHT, np.where(seen, residual, BRIGHT)),
        (BRIGHT, BRIGHT + share * (normals - BRIGHT)),
        (DARK, np.where(seen, WHITE, DARK + share * (HIDDEN - DARK))),
    )
    sheet = np.empty((size + LABEL, len(pictures) * size, 3), np.uint8)
    sheet[:LABEL] = _labels(size)
    for number, (ground, object_there) in enumerate(pictures):
        panel = np.empty((size * size, 3), np.uint8)
        panel[:] = np.round(ground)
        panel[here] = object_there.clip(0, 255).round()
        sheet[LABEL:, number * size : (number + 1) * size] = panel.reshape(size, size, 3)
    return sheet


@functools.cache
def _labels(size: int) -> np.ndarray:
    """Return names of `draw_panels` of a size beside each other, (LABEL, 5 size, 3) uint8."""
    panel_names = ("photo", "re-rendering", "residual", "normals", "mask")
    image = Image.new("RGB", (len(panel_names) * size, LABEL), "white")
    pen, font = ImageDraw.Draw(image), ImageFont.load_default(14)
    for number, name in enumerate(panel_names):
        pen.text((number * size + 6, 3), name, fill=(0, 0, 0), font=font)
    return np.asarray(image)


def part_colours(shown: CloseUp, albedo: np.ndarray, reflectance: np.ndarray) -> np.ndarray:
    """Return linear RGB (parts, 3) of each part's surface.

    The albedo (3,) times the part's reflectance (parts,) and the photo over the re-rendering, the median of
    where the part is visible, darkened into [0, 1]; without the photo where too little is visible.
    """
    colours: np.ndarray = (reflectance[:, None] * albedo).astype(np.float32)
    seen = shown.visible & (shown.coverage > 0.99)
    light = (shown.rendering[seen] / np.maximum(albedo, 1e-3)).mean(-1)
    photo, owner = shown.photo[seen], np.where(light > 0.02, shown.part[seen], -1)
    for part, share in enumerate(reflectance):
        here = owner == part
        if here.sum() >= MIN_PIXELS:
            # Like `np.median`, which loads numpy.ma: a twentieth of a second.
            colour = share * np.quantile(photo[here] / light[here][:, None], 0.5, axis=0)
            colours[part] = colour / max(1.0, colour.max())
    return colours


def _share(distance: np.ndarray) -> np.ndarray:
    """Return the share of a pixel within an edge that is so many pixels away, inwards."""
    return (0.5 + distance).clip(0, 1)
