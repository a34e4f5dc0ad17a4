"""The parts of a painted room. Metres; the viewpoint is the origin, Z up; all boxes lie along the axes."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal

import numpy as np

Array = np.ndarray

OUTWARD = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], np.float32)
"""Outward normals of the room's six sides, in their order."""
CEILING, FLOOR = 4, 5

Pattern = Literal[
    "plain", "doors", "books", "cushions", "leaves", "planks", "tiles", "carpet", "brick", "panelled"
]


@dataclass(frozen=True)
class Finish:
    """A surface: albedo (3,), a second one (3,) for its pattern, and the pattern's period in metres."""

    albedo: Array
    pattern: Pattern = "plain"
    second: Array = field(default_factory=lambda: np.full(3, 0.1, np.float32))
    period: float = 0.4


@dataclass(frozen=True)
class Box:
    """A solid from low to high (3,).

    Attributes:
        casts: Whether it is large enough to cast a noticeable shadow.
    """

    low: Array
    high: Array
    finish: Finish
    casts: bool = True


@dataclass(frozen=True)
class Patch:
    """A flat thing on a side of the room: a picture, a door, a rug; its rim, `border` m wide, in `second`."""

    side: int
    low: Array
    high: Array
    albedo: Array
    second: Array
    border: float


@dataclass(frozen=True)
class Panel:
    """A bright rectangle: a window or the face of a lamp.

    Attributes:
        centre: (3,).
        across, over: Unit vectors (3,) in it; across x over points where it shines.
        half: (2,) half extents.
        radiance: (3,).
        window: Whether it is a window, with bars (count across, count over) of `frame` albedo.
        veil: Share of the light that a curtain spreads evenly.
    """

    centre: Array
    across: Array
    over: Array
    half: Array
    radiance: Array
    window: bool = False
    bars: tuple[int, int] = (1, 1)
    frame: float = 0.6
    veil: float = 0.0

    @cached_property
    def normal(self) -> Array:
        """Return the unit vector (3,) in which it shines."""
        return np.cross(self.across, self.over)

    @property
    def area(self) -> float:
        """Return the area, square metres."""
        return float(4 * self.half[0] * self.half[1])


@dataclass(frozen=True)
class Bulb:
    """A small bright sphere: centre (3,) and radius, metres, and radiance (3,)."""

    centre: Array
    radius: float
    radiance: Array


@dataclass
class PanoramaRoom:
    """A furnished room as seen from the origin.

    Attributes:
        reach: (6,) distance of the sides.
        sides: A finish for each.
        sun: The direction to it (3,) and its irradiance / pi (3,) on a surface that faces it, or None.
        ambient: Factor of the light from all the room.
        skyline: Seed of the outdoor view.
        shade: Darkness of the side away from the light, 0 to 1.
    """

    reach: Array
    sides: list[Finish]
    boxes: list[Box] = field(default_factory=list)
    patches: list[Patch] = field(default_factory=list)
    panels: list[Panel] = field(default_factory=list)
    bulbs: list[Bulb] = field(default_factory=list)
    sun: tuple[Array, Array] | None = None
    ambient: float = 1.0
    shade: float = 0.0
    skyline: int = 0
