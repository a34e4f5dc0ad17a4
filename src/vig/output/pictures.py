"""Pictures of an explanation: outlines on the photo, and the fit beside it."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from vig.photo import Window
from vig.photo.outline import FINER
from vig.scene import Camera
from vig.scene.light import srgb_from_linear

OUTLINE = np.array([255, 210, 0], np.float32)
"""Colour of outlines, 8-bit sRGB; likewise `HIDDEN` of hidden pixels, mixed in by `HIDDEN_SHARE`."""
BORDER = np.array([20, 20, 20], np.float32)
"""Beside the outline, so that it shows on bright and yellow ground, too."""
HIDDEN = np.array([235, 40, 120], np.float32)
HIDDEN_SHARE = 0.5
THUMBNAIL = 320
"""Pixels of the longer side of the smallest pictures with outlines."""
PANEL = 300
"""Pixels a side of the pictures in `panels`."""
PANEL_NAMES = ("photo", "re-rendering", "residual", "normals", "mask")
LABEL = 22
"""Pixels of the line above each that says what it shows."""
LEAST_PIXELS = 30
"""Seen pixels from which a part's own colour is told."""
MOST_RESIDUAL = 0.5
"""Difference of sRGB brightness, of 1, that is drawn in full colour."""
WHITE, BRIGHT, DARK = np.float32(255), np.float32(217), np.float32(38)
"""8-bit levels of `panels`: of what is seen in the mask, and of grounds."""
RESIDUAL_COLOURS = np.array([[0.80, 0.10, 0.10], [0.10, 0.25, 0.80]], np.float32)
"""Where the photo is brighter, and where it is darker."""


def overlay(photo: np.ndarray, window: Window, covered: np.ndarray, visible: np.ndarray) -> np.ndarray:
    """The photo with the object's whole outline in yellow and its hidden pixels tinted pink.

    The outline is smooth, between two dark lines, and lies beside what the object covers; its width grows
    with the photo.

    Args:
        photo: (H, W, 3) uint8 sRGB.
        window: What was fitted.
        covered: Distance to the outline of what the object covers, see `vig.photo.outline_distance`.
        visible: The same of what of it is seen.

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


def line_width(height: float, width: float) -> float:
    """Pixels of an outline on a photo of a size, the dark lines beside it left out."""
    return max(1.5, min(height, width) / 250)


def line_reach(height: float, width: float) -> float:
    """Pixels from the object to the outer end of an outline and of the dark line beside it."""
    line = line_width(height, width)
    return line + 2 * max(1.0, line / 2) + 0.5


@dataclass(frozen=True)
class CloseUp:
    """An explained window of S x S pixels, upright.

    Attributes:
        photo: (S, S, 3) linear RGB.
        rendering: (S, S, 3) linear RGB, the explained object in front of black.
        coverage: (S, S) share of each pixel that it covers.
        normals: (S, S, 3) unit, in camera axes (x right, y down, z forward); 0 where nothing is.
        part: (S, S) int, the object's part, -1 where nothing is.
        depth: (S, S) metres along the optical axis, inf where nothing is.
        visible: (S, S) bool, where nothing hides it.
        camera: That of the rendering.
    """

    photo: np.ndarray
    rendering: np.ndarray
    coverage: np.ndarray
    normals: np.ndarray
    part: np.ndarray
    depth: np.ndarray
    visible: np.ndarray
    camera: Camera


def panels(shown: CloseUp) -> np.ndarray:
    """Photo, re-rendering, residual, normals and mask under their names: (S + label, 5 S, 3) uint8.

    The re-rendering stands in the photo, in front of everything. The residual is the photo's brightness less
    the rendering's where the object is seen: red where the photo is brighter, blue where it is darker.
    Normals are coloured by direction: red to the right, green up, blue towards the eye. The mask is white
    where the object is seen, pink where it is hidden.
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
    difference = (behind - drawn).mean(-1, keepdims=True) / (255 * MOST_RESIDUAL)
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
    """Names of `panels` of a size beside each other, (LABEL, 5 size, 3) uint8."""
    image = Image.new("RGB", (len(PANEL_NAMES) * size, LABEL), "white")
    pen, font = ImageDraw.Draw(image), ImageFont.load_default(14)
    for number, name in enumerate(PANEL_NAMES):
        pen.text((number * size + 6, 3), name, fill=(0, 0, 0), font=font)
    return np.asarray(image)


def part_colours(shown: CloseUp, albedo: np.ndarray, reflectance: np.ndarray) -> np.ndarray:
    """Linear RGB (parts, 3) of each part's surface.

    The albedo (3,) times the part's reflectance (parts,) and the photo over the re-rendering, the median of
    where the part is seen, made so dark that it is in [0, 1]; without the photo where too little is seen.
    """
    colours: np.ndarray = (reflectance[:, None] * albedo).astype(np.float32)
    seen = shown.visible & (shown.coverage > 0.99)
    light = (shown.rendering[seen] / np.maximum(albedo, 1e-3)).mean(-1)
    photo, owner = shown.photo[seen], np.where(light > 0.02, shown.part[seen], -1)
    for part, share in enumerate(reflectance):
        here = owner == part
        if here.sum() >= LEAST_PIXELS:
            # As `np.median`, which loads numpy.ma: a twentieth of a second.
            colour = share * np.quantile(photo[here] / light[here][:, None], 0.5, axis=0)
            colours[part] = colour / max(1.0, colour.max())
    return colours


def _share(distance: np.ndarray) -> np.ndarray:
    """Share of a pixel within an edge that is so many pixels away, inwards."""
    share: np.ndarray = (0.5 + distance).clip(0, 1)
    return share
