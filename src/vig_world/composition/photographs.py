"""How things are photographed: their surface, the camera's height, its lens."""

import math
from dataclasses import dataclass, replace

import numpy as np

from vig.photo import Window
from vig.scene import IMAGE_SIZE, ObjectClass
from vig_world.assets.coats import draw_coat, mean_albedo
from vig_world.dataset.spec import Coat, Lens
from vig_world.raster.view import View

DECORATED, METAL = 0.5, 0.08  # shares of painted and of metal objects
LEVEL, LOW = math.radians(15.0), math.radians(42.0)
"""Elevation below which most photographs are taken, and most of the others."""
LEVEL_SHARE, LOW_SHARE = 0.55, 0.33
MIN_GAP = 0.25
"""Least depth of the object, over the standard camera's distance: the camera keeps off the largest shapes."""
SCALE, SHIFT = 0.1, 0.04  # standard deviations of the log size, and of the place, of the content of boxes


@dataclass(frozen=True)
class Manner:
    """Manner in which one object is photographed; albedo (3,) is the coat's mean."""

    elevation: float
    coat: Coat
    albedo: np.ndarray
    lens: Lens
    seamless: bool


def draw_manner(
    rng: np.random.Generator, object_class: ObjectClass, vertices: np.ndarray, azimuth: float
) -> Manner:
    """Draw how an object (V, 3), metres, at an azimuth, radians, is photographed."""
    model = object_class.shape_model
    kind = rng.random()
    if kind < LEVEL_SHARE:
        elevation = rng.uniform(0.0, LEVEL)
    else:
        low = kind < LEVEL_SHARE + LOW_SHARE
        elevation = rng.uniform(LEVEL, LOW) if low else rng.uniform(LOW, 0.49 * math.pi)
    coat = draw_coat(rng, len(model.part_names), DECORATED, METAL)
    away = object_class.viewing_distance
    space = 2.5  # metres from the camera to the object, and above its support, that rooms have
    longest = max(1.0, min(6.0, space / away))  # focal length over the standard lens's
    farther = math.exp(rng.uniform(math.log(0.9), math.log(longest))) if rng.random() < 0.7 else 1.0
    if elevation > 0:
        highest = (space - object_class.target_height) / (away * math.sin(elevation))
        farther = min(farther, max(0.9, highest))
    # A tenth are rolled by any angle up to half a radian.
    roll = rng.uniform(-0.5, 0.5) if rng.random() < 0.1 else rng.normal(0, 0.05)
    lens, angles = Lens(farther, float(roll)), (azimuth, float(elevation))
    if (gap := _gap(lens, object_class, vertices, *angles)) < MIN_GAP:
        lens = replace(lens, farther=farther + MIN_GAP - gap)
    lens = framing_lens(lens, object_class, vertices, *angles)
    lens = reframe(lens, math.exp(rng.normal(0, SCALE)), rng.normal(0, SHIFT, 2))
    seamless = bool(rng.random() < 0.35)
    return Manner(float(elevation), coat, mean_albedo(coat, vertices, model), lens, seamless)


def _gap(
    lens: Lens, object_class: ObjectClass, vertices: np.ndarray, azimuth: float, elevation: float
) -> float:
    """Return the least depth of the vertices (V, 3) over the standard camera's distance."""
    view = View.through(lens, object_class, azimuth, elevation)
    return float((vertices @ view.rotation[2]).min() + view.translation[2]) / object_class.viewing_distance


def reframe(lens: Lens, scale: float, shift: np.ndarray) -> Lens:
    """Return a lens whose picture is larger by a factor and moved by (2,) of its sides."""
    x, y = (float(old * scale + new) for old, new in zip(lens.shift, shift, strict=True))
    return replace(lens, scale=lens.scale * scale, shift=(x, y))


def framing_lens(
    lens: Lens, object_class: ObjectClass, vertices: np.ndarray, azimuth: float, elevation: float
) -> Lens:
    """Return a lens that frames the object as the window of its box does."""
    view = View.through(lens, object_class, azimuth, elevation)
    in_camera = vertices @ view.rotation.T + view.translation
    x, y = (view.camera.focal * in_camera[:, :2] / in_camera[:, 2:] + [view.camera.cx, view.camera.cy]).T
    box = (float(x.min()), float(y.min()), float(np.ptp(x)), float(np.ptp(y)))
    window = Window.round_box(box)
    scale = IMAGE_SIZE / window.side
    middle = IMAGE_SIZE / 2
    shift = [(middle - start) * scale / IMAGE_SIZE - 0.5 for start in (window.left, window.top)]
    return replace(lens, scale=lens.scale * scale, shift=(shift[0], shift[1]))
