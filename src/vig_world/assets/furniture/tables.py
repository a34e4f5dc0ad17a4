"""Tables: dining and cafe tables, coffee and side tables, desks, trolleys, consoles."""

from __future__ import annotations

import numpy as np

from vig_world.assets.furniture import finishes
from vig_world.assets.furniture.fronts import FRONTS, HANDLES, LEGS, fronts, hoops, legs, splayed
from vig_world.assets.furniture.furniture import Furniture, family
from vig_world.assets.furniture.joinery import Joinery, Profile, rounding, slab, turned_post
from vig_world.assets.props.material import Material


def edge(rng: np.random.Generator, low: float, high: float) -> list[Profile]:
    """The edge of a top between two heights: bevelled, rounded, fully round or bevelled from below."""
    thick = high - low
    kind = rng.integers(4)
    if kind == 0:
        b = float(rng.uniform(0.0015, 0.004))
        return [[(b, low), (0.0, low + b)], [(0.0, low + b), (0.0, high - b)], [(0.0, high - b), (b, high)]]
    if kind == 1:
        r = float(rng.uniform(0.3, 0.5) * thick)
        return [[(0.0, low), *rounding(r, high - r, high, 3)]]
    if kind == 2:
        up = rounding(0.5 * thick, high - 0.5 * thick, high, 3)
        return [[*((inset, low + high - z) for inset, z in up[:0:-1]), *up]]
    b = 0.003
    under = float(rng.uniform(0.5, 1.2) * thick)
    lip = low + 0.45 * thick
    return [[(under, low), (0.0, lip)], [(0.0, lip), (0.0, high - b)], [(0.0, high - b), (b, high)]]


def _top(
    j: Joinery, stuff: Material, half: tuple[float, float], z: float, thick: float, radius: float, zone: str
) -> None:
    """A table's top whose upper side is at z, with its support: the largest rectangle of its aspect."""
    round_top = radius > 0.3 * min(half)
    j.add(stuff, slab(half, radius, edge(j.rng, z - thick, z), 9 if round_top else 3))
    margin = thick * 0.5 + 0.01 + radius * (1 - np.sqrt(0.5))
    x, y = half[0] - margin, half[1] - margin
    j.support(zone, (-x, -y), (x, y), z)


@family
def dining_table(rng: np.random.Generator) -> Furniture:
    """A table to eat at: oblong, oval or round, on four legs, hoops or a pedestal."""
    j = Joinery(rng)
    z, thick = float(rng.uniform(0.72, 0.76)), float(rng.uniform(0.02, 0.045))
    top, body = finishes.top(rng), finishes.carcass(rng)
    shape = rng.choice(["oblong", "oval", "round"], p=[0.65, 0.12, 0.23])
    if shape == "round":
        half = (float(rng.uniform(0.42, 0.6)),) * 2
    else:
        half = (float(rng.uniform(0.6, 1.0)), float(rng.uniform(0.38, 0.48)))
    radius = min(half) if shape != "oblong" else float(rng.choice([0.006, 0.02, 0.06]))
    _top(j, top, half, z, thick, radius, "dining")
    under = z - thick
    if shape == "oblong" and rng.uniform() < 0.25:
        hoops(j, finishes.fitting(rng), (half[0] - 0.12, half[1] - 0.06), under, 0.05)
    elif shape == "oblong" or rng.uniform() < 0.4:
        shrink = 0.72 if shape != "oblong" else 1.0
        x, y = shrink * half[0] - 0.06, shrink * half[1] - 0.06
        kind, wide = str(rng.choice(LEGS)), float(rng.uniform(0.05, 0.085))
        legs(j, body, (x, y), under, wide, kind)
        a, deep = 0.011, float(rng.uniform(0.07, 0.11))
        for side in (-1, 1):
            j.board(body, (-x + a, side * y - a, under - deep), (x - a, side * y + a, under))
            j.board(body, (side * x - a, -y + a, under - deep), (side * x + a, y - a, under))
    else:
        _pedestal(j, body, half, under)
    return j.done("dining_table")


def _pedestal(j: Joinery, stuff: Material, half: tuple[float, float], z: float) -> None:
    for x in (-0.5 * half[0], 0.5 * half[0]) if half[0] > 1.3 * half[1] else (0.0,):
        r = np.array([0, 1, 1, 0.75, 0.25, 0.2, 0.22, 0.3, 0.5, 0]) * 0.6 * half[1]
        h = np.array([0, 0, 0.02, 0.04, 0.1, 0.4, 0.7, 0.95, 1.0, 1.0]) * z
        j.add(stuff, turned_post(np.stack([r, h], -1), 16), (x, 0, 0))


@family
def cafe_table(rng: np.random.Generator) -> Furniture:
    """A small round or square table on one foot of metal."""
    j = Joinery(rng)
    z, thick = float(rng.uniform(0.72, 0.76)), float(rng.uniform(0.018, 0.035))
    half = (float(rng.uniform(0.3, 0.38)),) * 2
    _top(j, finishes.top(rng), half, z, thick, half[0] if rng.uniform() < 0.6 else 0.012, "drinks")
    metal = finishes.fitting(rng)
    r = np.array([0, 0.21, 0.22, 0.2, 0.035, 0.03, 0.03, 0.03, 0.1, 0.1, 0])
    h = np.array([0, 0, 0.012, 0.02, 0.035, 0.06, 0.3, z - 0.07, z - thick - 0.012, z - thick, z - thick])
    j.add(metal, turned_post(np.stack([r, h], -1), 16))
    return j.done("cafe_table")


@family
def coffee_table(rng: np.random.Generator) -> Furniture:
    """A low table before a sofa, often with a shelf below."""
    j = Joinery(rng)
    z, thick = float(rng.uniform(0.35, 0.48)), float(rng.uniform(0.018, 0.045))
    half = (float(rng.uniform(0.4, 0.62)), float(rng.uniform(0.24, 0.36)))
    top, body = finishes.top(rng), finishes.carcass(rng)
    rounded = rng.uniform() < 0.25
    _top(j, top, half, z, thick, half[1] if rounded else float(rng.choice([0.005, 0.03])), "drinks")
    x, y, under = half[0] - 0.05, half[1] - 0.05, z - thick
    if rounded:
        splayed(j, body, (0.8 * half[0], 0.72 * half[1]), under, 0.035, 0.2)
    elif rng.uniform() < 0.3:
        hoops(j, finishes.fitting(rng), (x, y), under, 0.025)
    else:
        legs(j, body, (x, y), under, float(rng.uniform(0.035, 0.06)), str(rng.choice(LEGS)))
        if rng.uniform() < 0.6:
            low = float(rng.uniform(0.1, 0.16))
            j.board(body, (-x, -y, low - 0.016), (x, y, low), 0.002)
            j.support("reading", (0.04 - x, 0.04 - y), (x - 0.04, y - 0.04), low, under - low)
    return j.done("coffee_table")


@family
def side_table(rng: np.random.Generator) -> Furniture:
    """A small table beside a sofa or an armchair."""
    j = Joinery(rng)
    z, thick = float(rng.uniform(0.45, 0.6)), float(rng.uniform(0.015, 0.03))
    half = (float(rng.uniform(0.2, 0.28)),) * 2
    rounded = rng.uniform() < 0.6
    _top(j, finishes.top(rng), half, z, thick, half[0] if rounded else 0.006, "drinks")
    under = z - thick
    if rounded and rng.uniform() < 0.5:
        _pedestal(j, finishes.carcass(rng), half, under)
    elif rounded:
        splayed(j, finishes.carcass(rng), (0.8 * half[0], 0.8 * half[1]), under, 0.028, 0.16)
    else:
        inner = half[0] - 0.03
        legs(j, finishes.carcass(rng), (inner, inner), under, 0.035, str(rng.choice(LEGS)))
    return j.done("side_table")


@family
def desk(rng: np.random.Generator) -> Furniture:
    """A writing desk, some with drawers on one side, some with a shelf on top at the back."""
    j = Joinery(rng)
    z, thick = float(rng.uniform(0.72, 0.76)), float(rng.uniform(0.02, 0.035))
    x, y = float(rng.uniform(0.55, 0.8)), float(rng.uniform(0.3, 0.38))
    top, body = finishes.top(rng), finishes.carcass(rng)
    under, margin = z - thick, 0.5 * thick + 0.01
    j.add(top, slab((x, y), 0.006, edge(rng, under, z)))
    back = y - margin
    if rng.uniform() < 0.3:
        back = y - 0.22
        high = z + float(rng.uniform(0.14, 0.3))
        j.board(body, (-x, back, high - 0.018), (x, y, high), 0.002)
        for side in np.linspace(-x, x - 0.018, 3).tolist():
            j.board(body, (side, back, z), (side + 0.018, y, high - 0.018))
        j.support("display", (0.01 - x, back + 0.01), (x - 0.01, y - 0.01), high)
        inner = (margin + 0.02 - x, back + 0.012)
        j.support("desk", inner, (-0.02, y - margin), z, high - 0.018 - z)
        j.support("desk", (0.02, inner[1]), (-inner[0], y - margin), z, high - 0.018 - z)
        back -= 0.02
    j.support("desk", (margin - x, margin - y), (x - margin, back), z)
    if rng.uniform() < 0.5:
        wide, left = float(rng.uniform(0.36, 0.44)), rng.uniform() < 0.5
        a = 0.03 - x if left else x - 0.03 - wide
        j.board(body, (a, 0.04 - y, 0.04), (a + wide, y - 0.03, under))
        style = (str(rng.choice(FRONTS)), str(rng.choice(HANDLES)))
        fronts(
            j,
            body,
            finishes.fitting(rng),
            (a, 0.05),
            (a + wide, under - 0.005),
            0.04 - y,
            [2.0, 1.2, 1.2],
            1,
            style,
        )
        b = x - 0.06 if left else 0.06 - x
        for end in (0.06 - y, y - 0.06):
            j.board(body, (b - 0.025, end - 0.025, 0.0), (b + 0.025, end + 0.025, under), 0.002)
        j.board(body, (a + 0.02, 0.06 - y, 0.0), (a + wide - 0.02, y - 0.05, 0.04))
    elif rng.uniform() < 0.4:
        hoops(j, finishes.fitting(rng), (x - 0.08, y - 0.05), under, 0.04)
    else:
        legs(j, body, (x - 0.06, y - 0.06), under, 0.05, str(rng.choice(LEGS)))
        j.board(body, (-x + 0.06, y - 0.07, under - 0.1), (x - 0.06, y - 0.05, under))
    return j.done("desk")


@family
def console(rng: np.random.Generator) -> Furniture:
    """A narrow table against a wall, as in halls."""
    j = Joinery(rng)
    z, thick = float(rng.uniform(0.74, 0.88)), float(rng.uniform(0.02, 0.04))
    x, y = float(rng.uniform(0.42, 0.65)), float(rng.uniform(0.16, 0.21))
    body = finishes.carcass(rng)
    under, margin = z - thick, 0.5 * thick + 0.01
    j.add(finishes.top(rng), slab((x, y), 0.005, edge(rng, under, z)))
    j.support("display", (margin - x, margin - y), (x - margin, y - margin), z)
    legs(j, body, (x - 0.04, y - 0.04), under, 0.042, str(rng.choice(LEGS)))
    if rng.uniform() < 0.6:
        deep = float(rng.uniform(0.1, 0.15))
        j.board(body, (-x + 0.04, 0.04 - y, under - deep), (x - 0.04, y - 0.03, under))
        fronts(
            j,
            body,
            finishes.fitting(rng),
            (-x + 0.06, under - deep),
            (x - 0.06, under),
            0.04 - y,
            [1.0],
            2,
            ("flat", str(rng.choice(HANDLES))),
        )
    if rng.uniform() < 0.5:
        low = float(rng.uniform(0.12, 0.2))
        j.board(body, (-x + 0.03, 0.03 - y, low - 0.018), (x - 0.03, y - 0.03, low), 0.002)
        j.support("storage", (0.07 - x, 0.06 - y), (x - 0.07, y - 0.05), low, under - 0.15 - low)
    return j.done("console")


@family
def tea_trolley(rng: np.random.Generator) -> Furniture:
    """Two or three trays with rims on a frame with wheels."""
    j = Joinery(rng)
    z = float(rng.uniform(0.7, 0.84))
    x, y = float(rng.uniform(0.3, 0.4)), float(rng.uniform(0.2, 0.26))
    tray, metal = finishes.top(rng), finishes.fitting(rng)
    count = int(rng.integers(2, 4))
    levels = np.linspace(0.18, z, count).tolist()
    for k, level in enumerate(levels):
        j.board(tray, (-x, -y, level - 0.015), (x, y, level), 0.002)
        room = levels[k + 1] - 0.015 - level if k + 1 < count else float("inf")
        j.support("drinks", (0.025 - x, 0.025 - y), (x - 0.025, y - 0.025), level, room)
        for side in (-1, 1):
            e, r = side * (y + 0.002), 0.006
            j.board(metal, (-x, e - r, level + 0.03), (x, e + r, level + 0.042))
            e = side * (x + 0.002)
            j.board(metal, (e - r, -y, level + 0.03), (e + r, y, level + 0.042))
    dark = finishes.plain((0.05, 0.05, 0.05))
    for sx in (-1, 1):
        for sy in (-1, 1):
            px, py = sx * x, sy * y
            j.board(metal, (px - 0.011, py - 0.011, 0.05), (px + 0.011, py + 0.011, z + 0.05), 0.004)
            wheel = slab((0.03, 0.03), 0.03, [[(0.0, 0.0), (0.0, 0.02)]], 3)
            j.add(dark, wheel, (px, py + 0.01, 0.03), tilt=np.pi / 2)
    if rng.uniform() < 0.6:
        for side in (-1, 1):
            j.board(metal, (x, side * y - 0.01, z + 0.036), (x + 0.09, side * y + 0.01, z + 0.05))
        j.board(metal, (x + 0.08, -y - 0.01, z + 0.034), (x + 0.1, y + 0.01, z + 0.052), 0.004)
    return j.done("tea_trolley")
