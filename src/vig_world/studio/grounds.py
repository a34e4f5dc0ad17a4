"""The background of a drawn object, and its shadow there."""

import math

import numpy as np

from vig.scene import IMAGE_SIZE
from vig_world import Split
from vig_world.assets.coats import any_colour
from vig_world.studio.layers import defocus, draw_sheet, draw_slope, pixels
from vig_world.studio.things import draw_thing


def draw_ground(rng: np.random.Generator, split: Split, roll: float = 0.0) -> np.ndarray:
    """Return an object's background, mostly rolled clockwise with the camera: (H, W, 3) linear RGB."""
    ground = _level_ground(rng, split)
    # Grounds of cameras that roll by less than 2 degrees stay level, and a quarter of the others.
    if abs(roll) < math.radians(2.0) or rng.random() < 0.25:
        return ground
    cos, sin = math.cos(roll), math.sin(roll)
    x, y = pixels()
    size = abs(cos) + abs(sin)  # so that its corners reach the picture's
    columns, rows = (cos * x + sin * y) / size, (cos * y - sin * x) / size
    source = [
        ((coordinate + 0.5) * IMAGE_SIZE).astype(int).clip(0, IMAGE_SIZE - 1)
        for coordinate in (rows, columns)
    ]
    return np.asarray(ground[source[0], source[1]])


def _level_ground(rng: np.random.Generator, split: Split) -> np.ndarray:
    """Return seamless, a table before a wall, or clutter: (H, W, 3) linear RGB."""
    x, y = pixels()
    kind = rng.random()
    if kind < 0.33:  # seamless
        colour_kind = rng.choice(3, p=[0.5, 0.15, 0.35])
        colour = (rng.uniform(0.75, 1.15, 3) ** 0.3, rng.uniform(0.0, 0.04, 3), any_colour(rng))[colour_kind]
        slope = rng.normal(0, 0.35, 2)
        glow = np.exp(-(x**2 + y**2) / rng.uniform(0.1, 1.0)) * rng.uniform(-0.1, 0.4)
        return (colour * np.clip(1 + slope[0] * x + slope[1] * y + glow, 0.05, 2)[..., None]).astype(
            np.float32
        )
    if kind < 0.6:  # a table before a wall
        edge = rng.uniform(-0.35, 0.4) + rng.normal(0, 0.05) * x
        below = np.clip((y - edge) * rng.choice([20, 60, 150]), 0, 1)[..., None]
        wall, table = (draw_sheet(rng) * draw_slope(rng) for _ in range(2))
        wall = defocus(wall, float(rng.uniform(0, 4)))
        picture = wall * (1 - below) + table * below
    else:  # clutter
        picture = draw_sheet(rng) * draw_slope(rng)
        for _ in range(int(rng.integers(4, 14))):
            centre = rng.uniform(-0.6, 0.6, 2)
            place = (*centre, rng.uniform(0.1, 0.5))
            picture = draw_thing(rng, split, [any_colour(rng)], place, in_front=False).over(picture)
        picture = defocus(picture, float(rng.choice([0.0, 1.5, 4.0, 8.0])))
    return np.clip(picture, 0, 1.5).astype(np.float32)


def cast_shadow(
    rng: np.random.Generator, ground: np.ndarray, cover: np.ndarray, place: tuple[float, float, float]
) -> np.ndarray:
    """Return the ground with a soft shadow under and beside the object on it."""
    if rng.random() < 0.25 or not cover.any():
        return ground
    x, y = pixels()
    foot = np.flatnonzero(cover.max(1) > 0.5)
    foot_y = (foot[-1] / IMAGE_SIZE - 0.5) if len(foot) else place[1]
    width, height = place[2] * rng.uniform(0.35, 0.8), place[2] * rng.uniform(0.05, 0.25)
    shift = rng.normal(0, 0.3) * width
    distance = ((x - place[0] - shift) / width) ** 2 + ((y - foot_y + 0.3 * height) / height) ** 2
    darkness = rng.uniform(0.15, 0.8) / (1 + np.exp(rng.uniform(2, 12) * (distance.clip(0, 5) - 1)))
    return np.asarray(ground * (1 - darkness[..., None]))
