"""Pictures of an explanation: outlines on the photo, and the fit beside it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from vig.photo import Window
from vig.photo.outline import FINER, REACH
from vig.scene.light import srgb_from_linear

OUTLINE = np.array([255, 210, 0], np.float32)
"""Colour of outlines, 8-bit sRGB; likewise `HIDDEN` of hidden pixels, mixed in by `HIDDEN_SHARE`."""
BORDER = np.array([20, 20, 20], np.float32)
"""Beside the outline, so that it shows on bright and yellow ground, too."""
HIDDEN = np.array([235, 40, 120], np.float32)
HIDDEN_SHARE = 0.5
PANEL = 300
"""Pixels a side of the pictures in `panels`."""
LABEL = 22
"""Pixels of the line above each that says what it shows."""
LEAST_PIXELS = 30
"""Seen pixels from which a part's own colour is told."""
MOST_RESIDUAL = 0.5
"""Difference of sRGB brightness, of 1, that is drawn in full colour."""


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
    line = line_width(height, width)
    border, scale = max(1.0, line / 2), window.side * FINER / len(covered)
    for tile in window.tiles(width, height):
        outer = scale * window.paste(covered, *tile, outside=REACH)
        inner = scale * window.paste(visible, *tile, outside=REACH)
        hidden = HIDDEN_SHARE * _share(-outer) * _share(inner)
        middle = np.abs(outer - border - line / 2)
        dark, bright = _share(line / 2 + border - middle), _share(line / 2 - middle)
        touched = (hidden > 0) | (dark > 0)
        colours = picture[tile][touched].astype(np.float32)
        for share, colour in ((hidden, HIDDEN), (dark, BORDER), (bright, OUTLINE)):
            colours += share[touched][:, None] * (colour - colours)
        picture[tile][touched] = colours.round()
    return picture


def line_width(height: int, width: int) -> float:
    """Pixels of an outline on a photo of a size, the dark lines beside it left out."""
    return max(1.5, min(height, width) / 250)


@dataclass(frozen=True)
class CloseUp:
    """An explained window of S x S pixels, upright.

    Attributes:
        photo: (S, S, 3) linear RGB.
        rendering: (S, S, 3) linear RGB, the explained object in front of black.
        coverage: (S, S) share of each pixel that it covers.
        normals: (S, S, 3) unit, in camera axes (x right, y down, z forward); 0 where nothing is.
        part: (S, S) int, the object's part, -1 where nothing is.
        visible: (S, S) bool, where nothing hides it.
    """

    photo: np.ndarray
    rendering: np.ndarray
    coverage: np.ndarray
    normals: np.ndarray
    part: np.ndarray
    visible: np.ndarray


def panels(shown: CloseUp) -> np.ndarray:
    """Photo, re-rendering, residual, normals and mask under their names: (S + label, 5 S, 3) uint8.

    The re-rendering stands in the photo, in front of everything. The residual is the photo's brightness less
    the rendering's where the object is seen: red where the photo is brighter, blue where it is darker.
    Normals are coloured by direction: red to the right, green up, blue towards the eye. The mask is white
    where the object is seen, pink where it is hidden.
    """
    share = shown.coverage[..., None]
    size, empty = len(share), np.array([1.0, 1.0, 1.0])
    # Both encoded before they are mixed, as screens would.
    photo, drawn = srgb_from_linear(shown.photo), srgb_from_linear(shown.rendering / np.maximum(share, 1e-6))
    difference = (photo - drawn).mean(-1, keepdims=True) / MOST_RESIDUAL
    towards = np.where(difference > 0, [0.80, 0.10, 0.10], [0.10, 0.25, 0.80])
    residual = empty + np.abs(difference).clip(0, 1) * (towards - empty)
    normals = 0.5 + 0.5 * shown.normals * [1, -1, -1]
    hidden = HIDDEN / 255
    pictures = {
        "photo": photo,
        "re-rendering": photo + share * (drawn - photo),
        "residual": np.where(shown.visible[..., None], residual, 0.85),
        "normals": 0.85 + share * (normals - 0.85),
        "mask": np.where(shown.visible[..., None], empty, 0.15 + share * (hidden - 0.15)),
    }
    sheet = np.full((size + LABEL, len(pictures) * size, 3), 255, np.uint8)
    for number, picture in enumerate(pictures.values()):
        sheet[LABEL:, number * size : (number + 1) * size] = (255 * picture.clip(0, 1)).round()
    image = Image.fromarray(sheet)
    pen, font = ImageDraw.Draw(image), ImageFont.load_default(14)
    for number, name in enumerate(pictures):
        pen.text((number * size + 6, 3), name, fill=(0, 0, 0), font=font)
    return np.asarray(image)


def part_colours(shown: CloseUp, albedo: np.ndarray, parts: int) -> np.ndarray:
    """Linear RGB (parts, 3) of each part.

    The albedo (3,) times the photo over the re-rendering, the median of where the part is seen; the albedo
    itself where too little of it is.
    """
    colours = np.tile(albedo.astype(np.float32), (parts, 1))
    light = (shown.rendering / np.maximum(albedo, 1e-3)).mean(-1)
    for part in range(parts):
        here = shown.visible & (shown.part == part) & (shown.coverage > 0.99) & (light > 0.02)
        if here.sum() >= LEAST_PIXELS:
            colours[part] = np.median(shown.photo[here] / light[here][:, None], axis=0).clip(0, 1)
    return colours


def _share(distance: np.ndarray) -> np.ndarray:
    """Share of a pixel within an edge that is so many pixels away, inwards."""
    share: np.ndarray = (0.5 + distance).clip(0, 1)
    return share
