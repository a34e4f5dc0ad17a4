"""Empty halls of any size, for views that no furnished room has space for."""

from __future__ import annotations

import numpy as np

from vig_world.assets.materials import plain
from vig_world.assets.things import Support
from vig_world.rooms.layout import Layout
from vig_world.rooms.shell import shell

EMPTY = "empty"
"""The kind of these rooms."""
HALF, SHORTER, HEIGHT = 4.0, 0.8, 0.8
"""Half the longer side, metres, of the smallest; over that, the least half of the other side and the
height of the ceiling."""
MIDDLE = 0.6
"""Share of each side on which things stand."""
SPACE = 2.2
"""Metres from the middle of the smallest within which the camera and the object have space."""


def draw_hall(rng: np.random.Generator, size: float = 1.0) -> Layout:
    """Return floor, four walls, a ceiling and skirting, `size` times as large as the smallest."""
    sides = HALF * size * rng.permutation([1.0, rng.uniform(SHORTER, 1.0)])
    x, y = sides.tolist()
    outline = np.array([[-x, -y], [x, -y], [x, y], [-x, y]])
    height = HEIGHT * HALF * size
    paint = plain(np.array([0.8, 0.79, 0.75]) * rng.uniform(0.85, 1.0), "wood", 0.5)
    parts = tuple(shell(rng, outline, height, [], 0.2, paint))
    support = Support("display", (0.0, 0.0, 0.0), (MIDDLE * x, MIDDLE * y))
    return Layout(EMPTY, parts, (support,), outline, height, np.zeros((0, 5, 2)))
