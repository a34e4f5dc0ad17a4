"""Draws items on one thread: the whole picture, or depth alone for the search of a layout."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from vig.scene.light import COSINE_LOBE, Y1
from vig_native import engine
from vig_world.raster.items import HARMONICS, Item, Target
from vig_world.raster.picture import CANVAS, Picture
from vig_world.raster.shadows import sky_weights, slopes
from vig_world.raster.view import View

SAMPLES: int = engine.SAMPLES  # samples of a picture along a pixel's side


@dataclass(frozen=True)
class SurfaceSamples:
    """Places on the object's surface of the N samples that show it.

    Attributes:
        points: (3, N) float32, the world, metres.
        normals: (3, N) float32, interpolated, about unit length.
        irradiance: (N,) float32, over pi.
        vertices: (N,) int32, a vertex of each one's face.
    """

    points: np.ndarray
    normals: np.ndarray
    irradiance: np.ndarray
    vertices: np.ndarray


Colouring = Callable[[SurfaceSamples], np.ndarray]  # linear RGB (N, 3) of an object's samples


def depth(items: Sequence[Item], view: View) -> tuple[np.ndarray, np.ndarray]:
    """Return depth (H, W) float32 metres along the optical axis, inf = nothing; and its item's owner or -1.

    One sample in the middle of each pixel of the view's camera. owner is (H, W) int32.
    """
    return engine.draw_depth([item.native for item in items], view.native)


def draw(
    items: Sequence[Item],
    target: Target,
    view: View,
    light: ArrayLike,
    colouring: Colouring | None = None,
    normals: bool = False,
) -> Picture:
    """Return the picture of an object and items, as the view's camera sees them, in SH light (9,).

    The object shows its vertices' light without cast shadows or gloss. Items get the same light less shadows
    of object and props and the ambient occlusion of rooms, with a little gloss. Four samples a pixel,
    averaged in linear light clipped to [0, 1]. colouring: gives the object's colour in place of its vertices'
    light. normals: whether the picture is to have normals.
    """
    camera, coefficients = view.camera, np.asarray(light, np.float64)
    direction = coefficients[[3, 1, 2]]
    strength = float(np.linalg.norm(direction))
    # a share of the light's first degree shows in highlights
    sun = *direction / max(strength, 1e-9), 0.2 * strength / Y1 / (2 * np.pi)
    lights = coefficients * COSINE_LOBE * HARMONICS, coefficients * HARMONICS, sun, target.albedo

    def colours(points: np.ndarray, across: np.ndarray, *rest: np.ndarray) -> np.ndarray:
        assert colouring is not None
        return np.ascontiguousarray(colouring(SurfaceSamples(points.T, across.T, *rest)), np.float32)

    image, depths, visible, support, directions = engine.draw_picture(
        target.native,
        [item.native for item in items],
        view.native,
        tuple(np.asarray(each, np.float32) for each in lights),
        slopes(),
        sky_weights(coefficients).astype(np.float32),
        float(np.abs(target.vertices).max()),
        None if colouring is None else colours,
        normals,
    )
    canvas = engine.silhouette(target.native, view.widen(CANVAS).native)
    height, width, aside = camera.height, camera.width, (CANVAS - 1) // 2
    amodal = canvas[aside * height : (aside + 1) * height, aside * width : (aside + 1) * width]
    half = SAMPLES**2 / 2
    return Picture(
        image=image,
        depth=depths,
        amodal=amodal,
        visible=(visible >= half) & amodal,
        by_support=(support >= half) & amodal,
        canvas=canvas,
        light=coefficients.astype(np.float32),
        normals=directions,
    )
