"""Random rooms as boxes and light sources: homes, kitchens, workplaces, halls and photo studios.

By day and by lamplight. Metres; the viewpoint is the origin, Z up; all boxes lie along the axes.
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from vig_world.assets.textures import colour, near

Array = np.ndarray
Generator = np.random.Generator

OUTWARD = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], np.float32)
"""Outward normals of the room's six sides, in their order."""
CEILING, FLOOR = 4, 5
_CLEAR = 0.45  # metres round the viewpoint that stay empty
_DAYLIGHT = np.array([[1.0, 0.96, 0.88], [0.80, 0.92, 1.10], [0.95, 1.0, 1.05]], np.float32)
_LAMPLIGHT = np.array([[1.25, 0.95, 0.55], [1.1, 0.98, 0.8], [0.95, 1.0, 1.05]], np.float32)
_SUNLIGHT = np.array([1.15, 0.98, 0.8], np.float32)
_WOODS = np.array([[0.5, 0.3, 0.15], [0.25, 0.13, 0.06], [0.65, 0.48, 0.3], [0.1, 0.06, 0.04]], np.float32)
_SHARES = {"home": 0.40, "kitchen": 0.12, "work": 0.16, "hall": 0.17, "studio": 0.15}
_SIZES = {  # of furniture: least and greatest width, depth, height and lift above the floor
    "cupboard": ((0.6, 0.3, 0.7, 0.0), (2.2, 0.6, 2.2, 0.0)),
    "seat": ((0.8, 0.6, 0.4, 0.0), (2.4, 0.9, 0.9, 0.0)),
    "bed": ((0.9, 1.9, 0.4, 0.0), (1.8, 2.1, 0.6, 0.0)),
    "table top": ((0.6, 0.5, 0.03, 0.4), (1.8, 0.95, 0.06, 0.8)),
    "hung cupboard": ((0.6, 0.25, 0.5, 1.35), (3.0, 0.4, 0.8, 1.5)),
    "screen": ((0.4, 0.05, 0.25, 0.5), (1.5, 0.08, 0.8, 0.9)),
    "crate": ((0.2, 0.2, 0.2, 0.0), (1.5, 1.2, 1.6, 0.0)),
    "picture": ((0.25, 0.02, 0.25, 1.1), (1.2, 0.04, 0.9, 1.6)),
    "door": ((0.8, 0.03, 1.95, 0.0), (1.0, 0.06, 2.1, 0.0)),
}


@dataclass(frozen=True)
class Box:
    """A solid from low to high (3,) of an albedo (3,); cells of `period` metres differ by `contrast`."""

    low: Array
    high: Array
    albedo: Array
    period: float = 0.3
    contrast: float = 0.0


@dataclass(frozen=True)
class Source:
    """A bright rectangle: a window or the face of a lamp; or, without `over`, a small bright sphere.

    Attributes:
        centre: (3,).
        across: Half its extent (3,) to one side; a sphere's radius is its length.
        over: Half its extent (3,) upwards; across x over points where it shines. None: a sphere.
        radiance: (3,).
        bars: Panes across and over of a window; None for a lamp.
        veil: Share of a window's light that a curtain spreads evenly.
    """

    centre: Array
    across: Array
    over: Array | None
    radiance: Array
    bars: tuple[int, int] | None = None
    veil: float = 0.0

    @property
    def normal(self) -> Array:
        """Return the unit vector (3,) in which it shines; a sphere's towards the viewpoint."""
        shines = -self.centre if self.over is None else np.cross(self.across, self.over)
        return shines / np.linalg.norm(shines)

    @property
    def area(self) -> float:
        """Return the area, square metres, that it shows from ahead."""
        reach = float(np.linalg.norm(self.across))
        return np.pi * reach**2 if self.over is None else 4 * reach * float(np.linalg.norm(self.over))


@dataclass
class PanoramaRoom:
    """A furnished room as seen from the origin.

    Attributes:
        reach: (6,) distance of the sides.
        sides: A box each, of which only the finish counts.
        sun: The direction to it (3,) and its irradiance / pi (3,) on a surface that faces it, or None.
        ambient: Factor of the light from all the room.
        skyline: Seed of the outdoor view.
        shade: Darkness of the side away from the light, 0 to 1.
    """

    reach: Array
    sides: list[Box]
    boxes: list[Box] = field(default_factory=list)
    sources: list[Source] = field(default_factory=list)
    sun: tuple[Array, Array] | None = None
    ambient: float = 1.0
    shade: float = 0.0
    skyline: int = 0

    def solid(self, low: ArrayLike, high: ArrayLike, albedo: Array, period: float, contrast: float) -> None:
        """Add a box where it leaves the viewpoint clear and is within the room."""
        a = np.maximum(np.asarray(low, np.float32), -self.reach[1::2])
        b = np.minimum(np.asarray(high, np.float32), self.reach[::2])
        if (b > a).all() and np.linalg.norm(np.maximum(np.maximum(a, -b), 0)) > _CLEAR:
            self.boxes.append(Box(a, b, albedo, period, contrast))


def finish(rng: Generator) -> Array:
    """Return the albedo (3,) of a thing in a room: wood, white, black, or a muted colour."""
    kind = rng.uniform()
    if kind < 0.4:
        return near(_WOODS[rng.integers(len(_WOODS))], rng, 0.25)
    if kind < 0.6:
        return near(np.full(3, rng.choice([0.06, 0.7, 0.8])), rng, 0.15)
    drawn = colour(rng)
    return (drawn.mean() + rng.uniform(0, 0.8) * (drawn - drawn.mean())).astype(np.float32)


def draw(rng: Generator) -> PanoramaRoom:
    """Return one random room with its furniture and lights."""
    kind = str(rng.choice(list(_SHARES), p=list(_SHARES.values())))
    widest, lowest, highest, pieces = {
        "home": (3.4, 2.3, 3.2, 20), "kitchen": (3.0, 2.3, 2.8, 14), "work": (4.8, 2.5, 3.4, 22),
        "hall": (11.0, 3.6, 7.0, 18), "studio": (4.5, 2.6, 4.0, 6),
    }[kind]  # fmt: skip
    room = _shell(rng, widest, (lowest, highest))
    {"home": _light_home, "kitchen": _light_kitchen, "work": _light_work, "hall": _light_hall,
     "studio": _light_studio}[kind](rng, room)  # fmt: skip
    if not room.sources:
        _bulbs(rng, room, 0.7, 4)
    for _ in range(rng.integers(pieces // 2, pieces)):
        _furnish(rng, room)
    room.ambient = _log_uniform(rng, 0.6, 3.0)
    room.shade = rng.uniform(0.1, 0.95)
    room.skyline = int(rng.integers(2**31))
    return room


def _log_uniform(rng: Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def _shell(rng: Generator, widest: float, height: tuple[float, float]) -> PanoramaRoom:
    """Return an empty room: its viewpoint at 0.7 to 1.3 m, at least 0.7 m from the walls."""
    eye = rng.uniform(0.7, 1.3)
    reach = np.append(rng.uniform(0.7, widest, 4), [max(rng.uniform(*height) - eye, 0.9), eye])
    paint = finish(rng) if rng.uniform() < 0.25 else near(np.full(3, rng.uniform(0.35, 0.85)), rng, 0.2)
    walls = [near(paint, rng, 0.08) if rng.uniform() < 0.85 else finish(rng) for _ in range(4)]
    ceiling = near(np.full(3, rng.uniform(0.6, 0.9)), rng, 0.08)
    floor = (
        finish(rng)
        if rng.uniform() < 0.5
        else near(rng.uniform(0.1, 0.6) * np.array([1, 0.95, 0.88]), rng, 0.15)
    )
    contrasts = [*(rng.choice([0.0, 0.0, 0.3], 4)), 0.0, rng.uniform(0.0, 0.5)]
    sides = [
        Box(np.zeros(3), np.zeros(3), albedo, float(rng.uniform(0.1, 0.6)), float(contrast))
        for albedo, contrast in zip([*walls, ceiling, floor], contrasts, strict=True)
    ]
    return PanoramaRoom(reach.astype(np.float32), sides)


def _furnish(rng: Generator, room: PanoramaRoom) -> None:
    """Place one piece, mostly with its back to a wall, turned by quarters; tables and seats as blocks."""
    name = str(rng.choice(list(_SIZES)))
    wide, deep, high, lift = rng.uniform(*_SIZES[name])
    side = int(rng.integers(4))
    away = 0.0 if rng.uniform() < 0.75 or name in ("picture", "door") else rng.uniform(0.3, 1.5)
    axis, sign = side // 2, 1 - 2 * (side % 2)
    low, high_corner = np.zeros(3), np.zeros(3)
    ends = sign * (room.reach[side] - away - np.array([deep, 0.0]))
    low[axis], high_corner[axis] = ends.min(), ends.max()
    along = 1 - axis
    start, end = -room.reach[2 * along + 1], room.reach[2 * along] - wide
    low[along] = rng.uniform(min(start, end), max(start, end))
    high_corner[along] = low[along] + wide
    low[2] = lift - room.reach[FLOOR]
    high_corner[2] = low[2] + high
    for source in room.sources:
        if source.bars is not None and source.over is not None:
            span = np.abs(source.across) + np.abs(source.over) + 0.3 * np.abs(source.normal)
            apart = np.abs(low + high_corner - 2 * source.centre) - (high_corner - low)
            if (apart < 2 * span).all():
                return  # it would stand or hang before a window
    room.solid(
        low, high_corner, finish(rng), float(rng.uniform(0.05, 0.6)), float(rng.choice([0.0, 0.4, 1.0]))
    )


def _rectangle(
    rng: Generator, reach: Array, side: int, size: ArrayLike, sill: float
) -> tuple[Array, Array, Array]:
    """Return centre, across and over (3,) of a rectangle (width, height) at random on a side."""
    inward = -OUTWARD[side]
    over = np.array([0, 1, 0] if side >= CEILING else [0, 0, 1], np.float32)
    across = np.cross(over, inward)
    low, high = -reach[1::2], reach[::2]
    room = np.array([np.abs(axis) @ (high - low) for axis in (across, over)])
    half = np.minimum(np.asarray(size) / 2, 0.45 * room)
    span = np.abs(across) * half[0] + np.abs(over) * half[1]
    centre = low + span + rng.uniform(0, 1, 3) * (high - low - 2 * span)
    if side < CEILING:
        centre[2] = low[2] + half[1] + min(sill, room[1] - 2 * half[1])
    centre[side // 2] = (reach[side] - 0.01) * OUTWARD[side, side // 2]
    return centre, half[0] * across, half[1] * over


def _windows(rng: Generator, room: PanoramaRoom, radiance: float, most: int = 4, tall: float = 2.2) -> None:
    """Add windows, mostly in one wall, some from the floor up; with curtains, and perhaps the sun behind."""
    main, first = int(rng.integers(4)), len(room.sources)
    tint = near(_DAYLIGHT[rng.integers(len(_DAYLIGHT))], rng, 0.1)
    bars = (int(rng.integers(1, 4)), int(rng.integers(1, 4)))
    veiled = rng.uniform() < 0.3
    for _ in range(rng.integers(1, most)):
        side = main if rng.uniform() < 0.7 else int(rng.integers(4))
        sill = 0.02 if rng.uniform() < 0.25 else rng.uniform(0.5, 1.1)
        place = _rectangle(rng, room.reach, side, rng.uniform([0.7, 0.9], [2.8, tall]), sill)
        light = radiance * rng.uniform(0.6, 1.2) * tint
        pane = Source(*place, light, bars, rng.uniform(0.5, 1.0) if veiled else 0.0)
        room.sources.append(pane)
        if rng.uniform() < 0.5:  # curtains to the floor on both sides
            cloth = finish(rng)
            for sign in (-1, 1):
                middle = pane.centre + 1.15 * sign * pane.across
                span = 0.15 * np.abs(pane.across) + 0.07 * np.abs(pane.normal)
                low, high = middle - span, middle + span
                low[2], high[2] = 0.03 - room.reach[FLOOR], pane.centre[2] + np.abs(place[2]).max() + 0.15
                room.solid(low, high, cloth, 0.12, 0.4)
    if rng.uniform() < 0.35:
        pane = room.sources[first]
        aside = pane.across / np.linalg.norm(pane.across)
        direction = rng.uniform(-0.8, 0.8) * aside - pane.normal + [0, 0, rng.uniform(0.2, 0.9)]
        strength = rng.uniform(1.0, 3.5) * radiance * _SUNLIGHT
        room.sun = (direction / np.linalg.norm(direction)).astype(np.float32), strength


def _bulbs(rng: Generator, room: PanoramaRoom, power: float, count: int) -> None:
    """Add spheres under the ceiling or standing about, at least 0.8 m away."""
    reach = room.reach
    tint = near(_LAMPLIGHT[rng.integers(len(_LAMPLIGHT))], rng, 0.1)
    for _ in range(count):
        centre = rng.uniform(-0.85 * reach[1::2], 0.85 * reach[::2])
        centre[2] = (
            rng.uniform(0.6, 0.92) * reach[CEILING] if rng.uniform() < 0.65 else rng.uniform(-0.3, 0.6)
        )
        centre *= max(1.0, 0.8 / float(np.linalg.norm(centre)))
        if (np.abs(centre) < 0.95 * np.where(centre > 0, reach[::2], reach[1::2])).all():
            radius = rng.uniform(0.04, 0.15)
            radiance = power * rng.uniform(0.4, 1.5) / (np.pi * radius**2) * tint
            room.sources.append(Source(centre, np.array([radius, 0.0, 0.0]), None, radiance))


def _ceiling(rng: Generator, room: PanoramaRoom, radiance: float, size: ArrayLike, spacing: float) -> None:
    """Add a grid of lamps (width, depth) in the ceiling, some of them off."""
    reach, half = room.reach, np.asarray(size) / 2
    tint = near(_LAMPLIGHT[rng.integers(1, len(_LAMPLIGHT))], rng, 0.06)
    lit, start = rng.uniform(0.5, 1.0), rng.uniform(0, 1, 2)
    for x in np.arange(-reach[1] + half[0] + 0.2 + start[0], reach[0] - half[0], spacing)[:8]:
        for y in np.arange(-reach[3] + half[1] + 0.2 + start[1], reach[2] - half[1], spacing)[:8]:
            if rng.uniform() < lit:
                centre = np.array([x, y, reach[CEILING] - 0.01])
                across, over = np.array([-half[0], 0, 0]), np.array([0, half[1], 0])
                room.sources.append(Source(centre, across, over, radiance * tint))


def _light_home(rng: Generator, room: PanoramaRoom) -> None:
    day, evening = rng.uniform(size=2) < [0.75, 0.65]
    _windows(rng, room, 1.0 if day else 0.01)
    if evening or not day:
        _bulbs(rng, room, _log_uniform(rng, 0.1, 4.0), int(rng.integers(1, 5)))
    if rng.uniform() < 0.15:
        _ceiling(rng, room, _log_uniform(rng, 20.0, 200.0), [0.08, 0.08], rng.uniform(0.9, 1.6))


def _light_kitchen(rng: Generator, room: PanoramaRoom) -> None:
    if rng.uniform() < 0.75:
        _windows(rng, room, 1.0, 3, 1.4)
    if rng.uniform() < 0.3:
        _ceiling(rng, room, _log_uniform(rng, 20.0, 200.0), [0.08, 0.08], rng.uniform(0.9, 1.6))
    elif rng.uniform() < 0.5 or not room.sources:
        _ceiling(rng, room, _log_uniform(rng, 0.5, 12.0), rng.uniform(0.2, 0.6, 2), rng.uniform(1.2, 2.0))


def _light_work(rng: Generator, room: PanoramaRoom) -> None:
    if rng.uniform() < 0.6:
        _windows(rng, room, 1.0, 5)
    size = [0.6, 0.6] if rng.uniform() < 0.5 else [0.15, 1.3]
    _ceiling(rng, room, _log_uniform(rng, 0.5, 8.0), size, rng.uniform(1.6, 2.6))


def _light_hall(rng: Generator, room: PanoramaRoom) -> None:
    """Add many lamps, high windows or a glass roof; and columns and beams."""
    reach, kind = room.reach, rng.uniform()
    if kind < 0.5:
        _ceiling(rng, room, _log_uniform(rng, 2.0, 20.0), [0.25, 1.5], rng.uniform(1.8, 3.0))
    elif kind < 0.8:
        for _ in range(3):
            _windows(rng, room, 1.0, 4, 3.0)
    if kind > 0.7:
        size = rng.uniform(0.2, 0.8, 2) * [reach[0] + reach[1], reach[2] + reach[3]]
        bars = (int(rng.integers(2, 8)), int(rng.integers(2, 6)))
        radiance = rng.uniform(0.6, 1.5) * _DAYLIGHT[2]
        room.sources.append(Source(*_rectangle(rng, reach, CEILING, size, 0.0), radiance, bars))
    stone, step = near(np.full(3, rng.uniform(0.2, 0.7)), rng, 0.1), rng.uniform(2.5, 4.5)
    for x in np.arange(-reach[1] + 1.0, reach[0] - 0.5, step):
        for y in (-0.55 * reach[3], 0.55 * reach[2]):
            if np.hypot(x, y) > 1.2:
                room.solid(
                    [x - 0.25, y - 0.25, -reach[FLOOR]], [x + 0.25, y + 0.25, reach[CEILING]], stone, 0.3, 0.1
                )
        room.solid(
            [x - 0.1, -reach[3], reach[4] - 0.35], [x + 0.1, reach[2], reach[4] - 0.12], stone, 0.3, 0.1
        )


def _light_studio(rng: Generator, room: PanoramaRoom) -> None:
    """Add one to three large lamps close by, between walls of white, grey or black."""
    tone = float(rng.choice([0.02, 0.03, 0.05, 0.2, 0.8]))
    room.sides[:FLOOR] = [
        Box(np.zeros(3), np.zeros(3), near(np.full(3, tone), rng, 0.15)) for _ in range(FLOOR)
    ]
    azimuth, opposed = rng.uniform(0, 2 * np.pi), rng.uniform() < 0.3
    for _ in range(2 if opposed else rng.integers(1, 4)):
        azimuth = azimuth + np.pi * rng.uniform(0.9, 1.1) if opposed else rng.uniform(0, 2 * np.pi)
        elevation = rng.uniform(0.0, 0.3 if opposed else 1.2)
        level = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
        toward = np.cos(elevation) * level + [0, 0, np.sin(elevation)]
        free = np.where(toward > 0, room.reach[::2], room.reach[1::2]) - 0.15
        distance = min(rng.uniform(1.0, 2.4), float((free / np.maximum(np.abs(toward), 0.05)).min()))
        across = np.array([level[1], -level[0], 0.0])
        half = rng.uniform([0.25, 0.25], [0.6, 0.75])
        radiance = _log_uniform(rng, 1.0, 6.0) * near(_LAMPLIGHT[rng.integers(1, 3)], rng, 0.08)
        over = half[1] * np.cross(-toward, across)
        room.sources.append(Source(distance * toward, half[0] * across, over, radiance))
    if rng.uniform() < 0.35:
        _windows(rng, room, _log_uniform(rng, 0.1, 1.0), 3)
