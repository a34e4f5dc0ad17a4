"""Furniture as a few boxes each, and where it stands in a room."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from vig_world.assets.panoramas.parts import FLOOR, Box, Finish, PanoramaRoom, Pattern
from vig_world.assets.textures import colour, near

Array = np.ndarray
Generator = np.random.Generator

_CLEAR = 0.45
"""Metres round the viewpoint that stay empty."""
_WOODS = np.array([[0.5, 0.3, 0.15], [0.25, 0.13, 0.06], [0.65, 0.48, 0.3], [0.1, 0.06, 0.04]], np.float32)


def wood(rng: Generator) -> Array:
    """Return the albedo (3,) of a wood, or of painted furniture."""
    if rng.uniform() < 0.35:
        return near(np.full(3, rng.choice([0.06, 0.7, 0.8])), rng, 0.15)
    return near(_WOODS[rng.integers(len(_WOODS))], rng, 0.25)


def muted(rng: Generator, strength: float = 0.6) -> Array:
    """Return the albedo (3,) of cloth or paint: seldom as gaudy as small things are."""
    drawn = colour(rng)
    return (drawn.mean() + rng.uniform(0, strength) * (drawn - drawn.mean())).astype(np.float32)


def _box(x: tuple, y: tuple, z: tuple, finish: Finish, casts: bool = True) -> Box:
    low, high = np.array([x, y, z], np.float32).T
    return Box(np.ascontiguousarray(low), np.ascontiguousarray(high), finish, casts)


# Each piece has its back at y = 0 and its front towards -y, stands on z = 0 and is centred in x.


def _cupboard(rng: Generator, least: float = 0.7, most: float = 2.1, pattern: Pattern = "doors") -> list[Box]:
    w, d, h = rng.uniform([0.6, 0.3, least], [2.2, 0.6, most])
    albedo = wood(rng)
    finish = Finish(albedo, pattern, 0.3 * albedo, float(rng.uniform(0.3, 0.6)))
    return [_box((-w / 2, w / 2), (-d, 0), (0, h), finish)]


def _bookshelf(rng: Generator) -> list[Box]:
    w, h = rng.uniform([0.6, 1.2], [2.0, 2.2])
    return [_box((-w / 2, w / 2), (-0.3, 0), (0, h), Finish(wood(rng), "books", period=0.32))]


def _sofa(rng: Generator) -> list[Box]:
    w, cloth = rng.uniform(0.8, 2.4), Finish(muted(rng), "cushions", period=0.65)
    arms = [_box((s * w / 2 - 0.1, s * w / 2 + 0.1), (-0.85, 0), (0, 0.6), cloth) for s in (-1, 1)]
    return [
        _box((-w / 2, w / 2), (-0.85, 0), (0.1, 0.42), cloth),
        _box((-w / 2, w / 2), (-0.25, 0), (0.3, 0.85), cloth),
        *arms,
    ]


def _bed(rng: Generator) -> list[Box]:
    w, frame = rng.uniform(0.9, 1.8), Finish(wood(rng))
    sheet = Finish(near(np.full(3, 0.7), rng, 0.2))
    return [
        _box((-w / 2, w / 2), (-2.0, 0), (0.1, 0.35), frame),
        _box((-w / 2, w / 2), (-0.06, 0), (0, rng.uniform(0.7, 1.1)), frame),
        _box(
            (-w / 2 + 0.03, w / 2 - 0.03),
            (-1.95, -0.5),
            (0.3, 0.55),
            Finish(muted(rng), "cushions", period=0.8),
        ),
        _box((-w / 2 + 0.1, w / 2 - 0.1), (-0.5, -0.1), (0.3, 0.6), sheet),
    ]


def _seat(rng: Generator, finish: Finish) -> list[Box]:
    legs = [
        _box((x - 0.02, x + 0.02), (y - 0.02, y + 0.02), (0, 0.44), finish, casts=False)
        for x in (-0.19, 0.19) for y in (-0.4, -0.02)
    ]  # fmt: skip
    return [
        _box((-0.21, 0.21), (-0.42, 0), (0.44, 0.48), finish),
        _box((-0.2, 0.2), (-0.03, 0), (0.5, 0.9), finish),
        *legs,
    ]


def _table(rng: Generator, height: float = 0.74) -> list[Box]:
    w, d = rng.uniform([0.8, 0.6], [1.8, 0.95])
    finish = Finish(wood(rng))
    legs = [
        _box((x - 0.03, x + 0.03), (y - 0.03, y + 0.03), (0, height), finish, casts=False)
        for x in (-w / 2 + 0.05, w / 2 - 0.05) for y in (-d + 0.05, -0.05)
    ]  # fmt: skip
    return [_box((-w / 2, w / 2), (-d, 0), (height - 0.04, height), finish), *legs]


def _dining(rng: Generator) -> list[Box]:
    boxes, finish = _table(rng), Finish(wood(rng))
    for x in rng.permutation([-0.45, 0.05, 0.5])[: rng.integers(1, 4)]:
        for box in _seat(rng, finish):
            offset = np.array([x, 0.35, 0], np.float32)
            boxes.append(Box(box.low + offset, box.high + offset, finish, box.casts))
    return boxes


def _desk(rng: Generator) -> list[Box]:
    screen = Finish(np.full(3, 0.03, np.float32))
    w = rng.uniform(0.4, 0.65)
    return [
        *_table(rng),
        _box((-w / 2, w / 2), (-0.25, -0.2), (0.86, 0.86 + 0.6 * w), screen),
        _box((-0.04, 0.04), (-0.24, -0.2), (0.74, 0.9), screen, casts=False),
    ]


def _television(rng: Generator) -> list[Box]:
    w = rng.uniform(0.8, 1.5)
    bench = Finish(wood(rng), "doors", np.full(3, 0.05, np.float32), 0.5)
    return [
        _box((-w * 0.7, w * 0.7), (-0.4, 0), (0, 0.45), bench),
        _box((-w / 2, w / 2), (-0.2, -0.15), (0.55, 0.55 + 0.57 * w), Finish(np.full(3, 0.02, np.float32))),
    ]


def _plant(rng: Generator) -> list[Box]:
    green = Finish(near([0.06, 0.14, 0.04], rng, 0.4), "leaves", near([0.2, 0.32, 0.1], rng, 0.3), 0.07)
    height = rng.uniform(0.5, 1.5)
    boxes = [_box((-0.14, 0.14), (-0.34, -0.06), (0, 0.3), Finish(muted(rng)))]
    for share in (0.35, 0.6, 0.8, 1.0):
        x, y = rng.uniform(-0.12, 0.12, 2)
        r = rng.uniform(0.12, 0.3) * (1.2 - 0.5 * share)
        z = 0.3 + share * height
        boxes.append(_box((x - r, x + r), (y - 0.2 - r, y - 0.2 + r), (z - 0.3 * height, z), green))
    return boxes


def _counter(rng: Generator) -> list[Box]:
    """Return a run of kitchen cupboards, its upper row too."""
    w, albedo = rng.uniform(1.5, 3.6), wood(rng)
    finish = Finish(albedo, "doors", 0.4 * albedo, 0.5)
    boxes = [
        _box((-w / 2, w / 2), (-0.58, 0), (0, 0.86), finish),
        _box(
            (-w / 2, w / 2),
            (-0.62, 0),
            (0.86, 0.9),
            Finish(near(np.full(3, rng.choice([0.1, 0.4, 0.7])), rng)),
        ),
    ]
    if rng.uniform() < 0.7:
        boxes.append(_box((-w / 2, w / 2 - rng.uniform(0, 1)), (-0.35, 0), (1.45, 2.15), finish))
    for _ in range(rng.integers(1, 5)):
        x, s, h = rng.uniform([-w / 2, 0.1, 0.1], [w / 2 - 0.3, 0.35, 0.4])
        boxes.append(_box((x, x + s), (-0.4, -0.15), (0.9, 0.9 + h), Finish(muted(rng, 1.0)), casts=False))
    return boxes


def _crate(rng: Generator) -> list[Box]:
    w, d, h = rng.uniform([0.3, 0.3, 0.2], [1.5, 1.2, 1.6])
    return [_box((-w / 2, w / 2), (-d, 0), (0, h), Finish(muted(rng, 0.8), "panelled", period=0.3))]


Maker = Callable[[Generator], list[Box]]
AT_HOME: tuple[Maker, ...] = (
    _sofa, _sofa, _cupboard, _cupboard, _bookshelf, _bookshelf, _television, _plant, _bed, _dining, _desk,
)  # fmt: skip
IN_KITCHENS: tuple[Maker, ...] = (_counter, _counter, _cupboard, _dining, _table, _plant)
AT_WORK: tuple[Maker, ...] = (_desk, _desk, _table, _cupboard, _bookshelf, _crate, _plant, _counter)


def furnish(rng: Generator, room: PanoramaRoom, makers: tuple[Maker, ...], count: int) -> None:
    """Place up to `count` pieces in a room, mostly along its walls, clear of each other and the viewpoint."""
    taken: list[tuple[Array, Array]] = []
    for _ in range(count):
        piece = makers[rng.integers(len(makers))](rng)
        for _ in range(4):
            boxes = _placed(rng, room.reach, piece)
            low, high = (pick([getattr(b, key) for b in boxes], axis=0)
                         for pick, key in ((np.min, "low"), (np.max, "high")))  # fmt: skip
            if _fits(room.reach, low, high, boxes) and not any(
                (low < other[1]).all() and (high > other[0]).all() for other in taken
            ):
                taken.append((low, high))
                room.boxes += boxes
                break


def _placed(rng: Generator, reach: Array, piece: list[Box]) -> list[Box]:
    """Return a piece with its back to a random wall, or free in the room, turned by quarters."""
    side = int(rng.integers(4))
    quarter = (3, 1, 0, 2)[side]  # turns +y to the side
    c, s = ((1, 0), (0, 1), (-1, 0), (0, -1))[quarter]
    turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]], np.float32)
    away = 0.0 if rng.uniform() < 0.75 else rng.uniform(0.3, 1.5)
    along = 1 - side // 2
    place = np.zeros(3, np.float32)
    place[side // 2] = (reach[side] - away) * (1 if side % 2 == 0 else -1)
    place[along] = rng.uniform(-reach[2 * along + 1], reach[2 * along])
    place[2] = -reach[FLOOR]
    result = []
    for box in piece:
        a, b = turn @ box.low + place, turn @ box.high + place
        result.append(Box(np.minimum(a, b), np.maximum(a, b), box.finish, box.casts))
    return result


def _fits(reach: Array, low: Array, high: Array, boxes: list[Box]) -> bool:
    if (low < -reach[1::2] - 1e-3).any() or (high > reach[::2] + 1e-3).any():
        return False
    gaps = [np.linalg.norm(np.maximum(np.maximum(box.low, -box.high), 0)) for box in boxes]
    return bool(min(gaps) > _CLEAR)
