"""Random rooms: homes, kitchens, workplaces, halls and photo studios, by day and by lamplight."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from vig_world.assets.panoramas.furnishing import AT_HOME, AT_WORK, IN_KITCHENS, furnish, muted, wood
from vig_world.assets.panoramas.parts import (
    CEILING,
    FLOOR,
    OUTWARD,
    Box,
    Bulb,
    Finish,
    Panel,
    PanoramaRoom,
    Patch,
    Pattern,
)
from vig_world.assets.textures import near

Array = np.ndarray
Generator = np.random.Generator

_DAYLIGHT = np.array([[1.0, 0.96, 0.88], [0.80, 0.92, 1.10], [0.95, 1.0, 1.05]], np.float32)
_LAMPLIGHT = np.array([[1.25, 0.95, 0.55], [1.1, 0.98, 0.8], [0.95, 1.0, 1.05]], np.float32)
_SUNLIGHT = np.array([1.15, 0.98, 0.8], np.float32)
_KINDS = ("home", "kitchen", "work", "hall", "studio")
_SHARES = (0.40, 0.12, 0.16, 0.17, 0.15)


def draw(rng: Generator) -> PanoramaRoom:
    """Return one random room with its furniture and lights."""
    kind = str(rng.choice(_KINDS, p=_SHARES))
    make = {"home": _home, "kitchen": _kitchen, "work": _work, "hall": _hall, "studio": _studio}[kind]
    room = make(rng)
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
    paint = near(np.full(3, rng.uniform(0.35, 0.85), np.float32), rng, 0.2)
    if rng.uniform() < 0.25:
        paint = muted(rng)
    walls = [_wall(rng, near(paint, rng, 0.08) if rng.uniform() < 0.85 else muted(rng)) for _ in range(4)]
    ceiling = Finish(near(np.full(3, rng.uniform(0.6, 0.9), np.float32), rng, 0.08))
    return PanoramaRoom(reach.astype(np.float32), [*walls, ceiling, _floor(rng)])


def _wall(rng: Generator, albedo: Array) -> Finish:
    draw = rng.uniform()
    if draw < 0.12:
        brick = near([0.45, 0.22, 0.14], rng, 0.3) if rng.uniform() < 0.6 else albedo
        return Finish(brick, "brick", near(np.full(3, 0.5), rng, 0.2), 0.075)
    if draw < 0.24:
        return Finish(albedo, "panelled", wood(rng), float(rng.uniform(0.3, 0.9)))
    return Finish(albedo, "plain", near(np.full(3, 0.6), rng, 0.3))


def _floor(rng: Generator) -> Finish:
    pattern: Pattern = ("planks", "planks", "tiles", "carpet")[rng.integers(4)]
    base = wood(rng) if pattern == "planks" else np.full(3, rng.uniform(0.1, 0.6)) * [1.0, 0.95, 0.88]
    albedo = near(base, rng, 0.15)
    second = near(albedo * rng.choice([0.4, 0.8, 1.6]), rng, 0.1)
    return Finish(albedo, pattern, second, float(rng.uniform(0.1, 0.25) if pattern == "planks" else 0.45))


def _rectangle(
    rng: Generator, reach: Array, side: int, size: Array, sill: float
) -> tuple[Array, Array, Array, Array]:
    """Return centre, across, over and half extents of a rectangle (width, height) at random on a side."""
    inward = -OUTWARD[side]
    over = np.array([0, 1, 0] if side >= CEILING else [0, 0, 1], np.float32)
    across = np.cross(over, inward)
    low, high = -reach[1::2], reach[::2]
    room = np.array([np.abs(axis) @ (high - low) for axis in (across, over)])
    half = np.minimum(np.asarray(size) / 2, 0.45 * room).astype(np.float32)
    span = np.abs(across) * half[0] + np.abs(over) * half[1]
    centre = low + span + rng.uniform(0, 1, 3) * (high - low - 2 * span)
    if side < CEILING:
        centre[2] = low[2] + half[1] + min(sill, room[1] - 2 * half[1])
    centre[side // 2] = reach[side] * OUTWARD[side, side // 2]
    return centre.astype(np.float32), across, over, half


def _windows(rng: Generator, room: PanoramaRoom, radiance: float, most: int = 4, tall: float = 2.2) -> None:
    """Add windows, mostly in one wall, some from the floor up; with curtains, and perhaps the sun behind."""
    main = int(rng.integers(4))
    tint = near(_DAYLIGHT[rng.integers(len(_DAYLIGHT))], rng, 0.1)
    bars = (int(rng.integers(1, 4)), int(rng.integers(1, 4)))
    frame, veil = rng.choice([0.05, 0.3, 0.7, 0.8]), rng.uniform() < 0.3
    for _ in range(rng.integers(1, most)):
        side = main if rng.uniform() < 0.7 else int(rng.integers(4))
        sill = 0.02 if rng.uniform() < 0.25 else rng.uniform(0.5, 1.1)
        size = rng.uniform([0.7, 0.9], [2.8, tall])
        centre, across, over, half = _rectangle(rng, room.reach, side, size, sill)
        light = radiance * rng.uniform(0.6, 1.2) * tint
        panel = Panel(
            centre + 0.01 * -OUTWARD[side], across, over, half, light.astype(np.float32), True, bars,
            float(frame), rng.uniform(0.5, 1.0) if veil else 0.0,
        )  # fmt: skip
        room.panels.append(panel)
        if rng.uniform() < 0.5:
            _curtains(rng, room, panel)
    if rng.uniform() < 0.35:
        outward = -room.panels[0].normal
        direction = (
            outward + rng.uniform(-0.8, 0.8) * room.panels[0].across + np.array([0, 0, rng.uniform(0.2, 0.9)])
        )
        unit = (direction / np.linalg.norm(direction)).astype(np.float32)
        room.sun = unit, (rng.uniform(1.0, 3.5) * radiance * _SUNLIGHT).astype(np.float32)


def _curtains(rng: Generator, room: PanoramaRoom, window: Panel) -> None:
    """Add curtains that hang to the floor on both sides of a window."""
    finish = Finish(muted(rng), "cushions", period=0.12)
    top = min(window.centre[2] + window.half[1] + 0.15, room.reach[CEILING])
    for sign in (-1, 1):
        width = rng.uniform(0.1, 0.35)
        middle = window.centre + sign * (window.half[0] + 0.3 * width) * window.across
        span = np.abs(window.across) * width + np.abs(window.normal) * 0.07
        low, high = middle - span, middle + span
        low[2], high[2] = -room.reach[FLOOR] + 0.03, top
        room.boxes.append(Box(low.astype(np.float32), high.astype(np.float32), finish))


def _decorate(rng: Generator, room: PanoramaRoom, most: int = 6) -> None:
    """Add a door or two, pictures, and perhaps a rug."""
    reach = room.reach
    for _ in range(rng.integers(0, 3)):
        frame = near(np.full(3, rng.choice([0.1, 0.6, 0.75])), rng, 0.1)
        place = _rectangle(rng, reach, int(rng.integers(4)), rng.uniform([0.8, 1.95], [1.0, 2.1]), 0.0)
        _patch(room, place, wood(rng), frame, 0.06)
    for _ in range(rng.integers(0, most)):
        size = rng.uniform([0.25, 0.25], [1.2, 0.9])
        place = _rectangle(rng, reach, int(rng.integers(4)), size, rng.uniform(1.1, 1.6))
        _patch(room, place, muted(rng, 1.0), wood(rng), rng.uniform(0.02, 0.07))
    if rng.uniform() < 0.45:
        place = _rectangle(rng, reach, FLOOR, rng.uniform([1.2, 0.9], [3.0, 2.4]), 0.0)
        _patch(room, place, muted(rng, 0.8), muted(rng, 0.8), 0.12)


def _patch(
    room: PanoramaRoom, place: tuple[Array, Array, Array, Array], albedo: Array, second: Array, border: float
) -> None:
    centre, across, over, half = place
    span = np.abs(across) * half[0] + np.abs(over) * half[1]
    axis = int(np.argmin(span))
    side = 2 * axis + int(centre[axis] < 0)
    room.patches.append(Patch(side, centre - span, centre + span, albedo, second, border))


def _bulbs(rng: Generator, room: PanoramaRoom, power: float, count: int) -> None:
    """Add lamps: under the ceiling, or standing about with a foot; at least 0.8 m away."""
    reach = room.reach
    tint = near(_LAMPLIGHT[rng.integers(len(_LAMPLIGHT))], rng, 0.1)
    dark = Finish(np.full(3, rng.choice([0.04, 0.3, 0.6]), np.float32))
    for _ in range(count):
        centre = rng.uniform(-0.85 * reach[1::2], 0.85 * reach[::2])
        hanging = rng.uniform() < 0.65
        centre[2] = rng.uniform(0.6, 0.92) * reach[CEILING] if hanging else rng.uniform(-0.3, 0.6)
        centre *= max(1.0, 0.8 / float(np.linalg.norm(centre)))
        if (np.abs(centre) > 0.95 * np.where(centre > 0, reach[::2], reach[1::2])).any():
            continue
        radius = rng.uniform(0.04, 0.15)
        radiance = power * rng.uniform(0.4, 1.5) / (np.pi * radius**2) * tint
        room.bulbs.append(Bulb(centre.astype(np.float32), float(radius), radiance.astype(np.float32)))
        rod = np.array([0.015, 0.015, 0.0], np.float32)
        low, high = centre - rod, centre + rod
        if hanging:
            low[2], high[2] = centre[2] + radius, reach[CEILING]
        else:
            low[2], high[2] = -reach[FLOOR], centre[2] - radius
        room.boxes.append(Box(low.astype(np.float32), high.astype(np.float32), dark, casts=False))


def _ceiling_panels(
    rng: Generator, room: PanoramaRoom, radiance: float, size: ArrayLike, spacing: float
) -> None:
    """Add a grid of lamps in the ceiling, some of them off."""
    reach, half = room.reach, np.asarray(size, np.float32) / 2
    tint = near(_LAMPLIGHT[rng.integers(1, len(_LAMPLIGHT))], rng, 0.06)
    lit = rng.uniform(0.5, 1.0)
    start = rng.uniform(0, 1, 2)
    xs = np.arange(-reach[1] + half[0] + 0.2 + start[0], reach[0] - half[0], spacing)
    ys = np.arange(-reach[3] + half[1] + 0.2 + start[1], reach[2] - half[1], spacing)
    over, across = np.array([0, 1, 0], np.float32), np.array([-1, 0, 0], np.float32)
    for x in xs[:8]:
        for y in ys[:8]:
            if rng.uniform() < lit:
                centre = np.array([x, y, reach[CEILING] - 0.01], np.float32)
                room.panels.append(Panel(centre, across, over, half, (radiance * tint).astype(np.float32)))


def _downlights(rng: Generator, room: PanoramaRoom) -> None:
    """Add small bright spots let into the ceiling."""
    _ceiling_panels(rng, room, _log_uniform(rng, 20.0, 200.0), [0.08, 0.08], rng.uniform(0.9, 1.6))


def _home(rng: Generator) -> PanoramaRoom:
    room = _shell(rng, 3.4, (2.3, 3.2))
    day, evening = rng.uniform(size=2) < [0.75, 0.65]
    _windows(rng, room, 1.0 if day else 0.01)
    if evening or not day:
        _bulbs(rng, room, _log_uniform(rng, 0.1, 4.0), int(rng.integers(1, 5)))
    if rng.uniform() < 0.15:
        _downlights(rng, room)
    furnish(rng, room, AT_HOME, int(rng.integers(6, 13)))
    _decorate(rng, room)
    return room


def _kitchen(rng: Generator) -> PanoramaRoom:
    room = _shell(rng, 3.0, (2.3, 2.8))
    if rng.uniform() < 0.75:
        _windows(rng, room, 1.0, 3, 1.4)
    if rng.uniform() < 0.6 or not room.panels:
        if rng.uniform() < 0.5:
            _downlights(rng, room)
        else:
            radiance = _log_uniform(rng, 0.5, 12.0)
            _ceiling_panels(rng, room, radiance, rng.uniform(0.2, 0.6, 2), rng.uniform(1.2, 2.0))
    furnish(rng, room, IN_KITCHENS, int(rng.integers(4, 8)))
    _decorate(rng, room, 3)
    if not room.panels:
        _bulbs(rng, room, 0.5, 3)
    return room


def _work(rng: Generator) -> PanoramaRoom:
    room = _shell(rng, 4.8, (2.5, 3.4))
    if rng.uniform() < 0.6:
        _windows(rng, room, 1.0, 5)
    size = [0.6, 0.6] if rng.uniform() < 0.5 else [0.15, 1.3]
    _ceiling_panels(rng, room, _log_uniform(rng, 0.5, 8.0), size, rng.uniform(1.6, 2.6))
    furnish(rng, room, AT_WORK, int(rng.integers(8, 16)))
    _decorate(rng, room)
    return room


def _hall(rng: Generator) -> PanoramaRoom:
    """Return a large room: columns, beams, many lamps or high windows or a glass roof."""
    room = _shell(rng, 11.0, (3.6, 7.0))
    reach = room.reach
    draw = rng.uniform()
    if draw < 0.5:
        _ceiling_panels(rng, room, _log_uniform(rng, 2.0, 20.0), [0.25, 1.5], rng.uniform(1.8, 3.0))
    elif draw < 0.8:
        for _ in range(3):
            _windows(rng, room, 1.0, 4, 3.0)
    if draw > 0.7:  # a glass roof, now and then over dark walls
        if rng.uniform() < 0.5:
            room.sides[:CEILING] = [Finish(near(np.full(3, rng.uniform(0.05, 0.25)), rng, 0.2))] * 4
        size = rng.uniform(0.2, 0.8, 2) * [reach[0] + reach[1], reach[2] + reach[3]]
        place = _rectangle(rng, reach, CEILING, size, 0.0)
        bars = (int(rng.integers(2, 8)), int(rng.integers(2, 6)))
        room.panels.append(Panel(*place, rng.uniform(0.6, 1.5) * _DAYLIGHT[2], True, bars, 0.2))
    stone = Finish(near(np.full(3, rng.uniform(0.2, 0.7)), rng, 0.1))
    step, width = rng.uniform(2.5, 4.5), rng.uniform(0.15, 0.35)
    if rng.uniform() < 0.6:
        for x in np.arange(-reach[1] + 1.0, reach[0] - 0.5, step):
            for y in (-0.55 * reach[3], 0.55 * reach[2]):
                if np.hypot(x, y) > 1.2:
                    low = np.array([x - width, y - width, -reach[FLOOR]], np.float32)
                    high = np.array([x + width, y + width, reach[CEILING]], np.float32)
                    room.boxes.append(Box(low, high, stone))
    if rng.uniform() < 0.5:
        timber = Finish(wood(rng))
        for x in np.arange(-reach[1] + 0.6, reach[0], step / 2):
            low = np.array([x - 0.1, -reach[3], reach[CEILING] - 0.35], np.float32)
            high = np.array([x + 0.1, reach[2], reach[CEILING] - 0.12], np.float32)
            room.boxes.append(Box(low, high, timber))
    furnish(rng, room, (*AT_WORK, *AT_HOME), int(rng.integers(4, 12)))
    _decorate(rng, room)
    if not room.panels:
        _bulbs(rng, room, 1.0, 4)
    return room


def _studio(rng: Generator) -> PanoramaRoom:
    """Return a photo studio: one to three large lamps close by, walls white, grey or black."""
    room = _shell(rng, 4.5, (2.6, 4.0))
    tone = float(rng.choice([0.02, 0.03, 0.05, 0.2, 0.8]))
    room.sides = [Finish(near(np.full(3, tone), rng, 0.15)) for _ in range(5)] + [_floor(rng)]
    black = Finish(np.full(3, 0.03, np.float32))
    azimuth, opposed = rng.uniform(0, 2 * np.pi), rng.uniform() < 0.3
    distance = rng.uniform(1.0, 2.4)
    for _ in range(2 if opposed else rng.integers(1, 4)):
        azimuth = azimuth + np.pi * rng.uniform(0.9, 1.1) if opposed else rng.uniform(0, 2 * np.pi)
        elevation = rng.uniform(0.0, 0.3) if opposed else rng.uniform(0.0, 1.2)
        distance = distance if opposed else rng.uniform(1.0, 2.4)
        toward = np.array(
            [np.cos(azimuth) * np.cos(elevation), np.sin(azimuth) * np.cos(elevation), np.sin(elevation)]
        )
        room_for = (np.where(toward > 0, room.reach[::2], room.reach[1::2]) - 0.15) / np.maximum(
            np.abs(toward), 0.05
        )
        centre = min(distance, float(room_for.min())) * toward
        across = np.array([np.sin(azimuth), -np.cos(azimuth), 0.0])
        over = np.cross(-toward, across)
        half = rng.uniform([0.25, 0.25], [0.6, 0.75])
        a, b, c, d = (np.asarray(value, np.float32) for value in (centre, across, over, half))
        radiance = _log_uniform(rng, 1.0, 6.0) * near(_LAMPLIGHT[rng.integers(1, 3)], rng, 0.08)
        room.panels.append(Panel(a, b, c, d, radiance.astype(np.float32)))
        low, high = centre - 0.02, centre + 0.02
        low[2], high[2] = -room.reach[FLOOR], centre[2] - half[1]
        behind = 0.1 * toward * [1, 1, 0]
        if high[2] > low[2]:
            foot = (low + behind).astype(np.float32), (high + behind).astype(np.float32)
            room.boxes.append(Box(*foot, black, casts=False))
    if rng.uniform() < 0.35:
        _windows(rng, room, _log_uniform(rng, 0.1, 1.0), 3)
    furnish(rng, room, (*AT_WORK, *AT_HOME), int(rng.integers(1, 6)))
    return room
