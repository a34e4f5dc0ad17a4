"""Seats: chairs, stools, armchairs, sofas, benches and window seats."""

from __future__ import annotations

import numpy as np

from vig_world.assets.furniture import finishes
from vig_world.assets.furniture.fronts import LEGS, hoops, legs, splayed
from vig_world.assets.furniture.furniture import Furniture, family
from vig_world.assets.furniture.joinery import Joinery, board, cushion, rounding, slab, stick
from vig_world.assets.props.material import Material


def _seat(
    j: Joinery, stuff: Material, half: tuple[float, float], z: float, padded: bool, radius: float = 0.03
) -> None:
    """A chair's seat whose level middle is at z, with its support."""
    if padded:
        j.add(stuff, cushion(half, 0.06, max(radius, 0.03)), (0, 0, z - 0.06))
    else:
        j.add(
            stuff,
            slab(half, radius, [[(0.006, z - 0.025), (0.0, z - 0.018), *rounding(0.008, z - 0.008, z, 2)]]),
        )
    x, y = half[0] - 0.04 - 0.3 * radius, half[1] - 0.04 - 0.3 * radius
    j.support("reading", (-x, -y), (x, y), z)


@family
def chair(rng: np.random.Generator) -> Furniture:
    """A chair without arms: seat of wood or padded, the back of slats, rungs, one board or padded."""
    j = Joinery(rng)
    z, x, y = (float(value) for value in rng.uniform([0.44, 0.2, 0.2], [0.475, 0.235, 0.225]))
    high = float(rng.uniform(0.8, 0.98))
    wood, cover = finishes.carcass(rng, 0.3), finishes.fabric(rng)
    padded = rng.uniform() < 0.45
    _seat(j, cover if padded else wood, (x, y), z, padded, float(rng.choice([0.02, 0.04, 0.09])))
    under, lean = z - (0.06 if padded else 0.025), float(rng.uniform(0.04, 0.09))
    metal = rng.uniform() < 0.25
    frame = finishes.fitting(rng) if metal else wood
    if metal:
        hoops(j, frame, (x - 0.02, y - 0.02), under, 0.022)
    elif rng.uniform() < 0.4:
        splayed(j, frame, (x, y), under, 0.034, 0.1)
    else:
        legs(j, frame, (x - 0.025, y - 0.025), under, 0.036, str(rng.choice(["square", "tapered", "round"])))
        for side in (-1, 1):
            j.board(
                frame,
                (side * (x - 0.025) - 0.01, -y + 0.03, under - 0.06),
                (side * (x - 0.025) + 0.01, y - 0.03, under),
            )
            j.board(
                frame,
                (-x + 0.03, side * (y - 0.025) - 0.01, under - 0.06),
                (x - 0.03, side * (y - 0.025) + 0.01, under),
            )
    _back(j, frame, cover if padded and rng.uniform() < 0.6 else wood, x, y, z, high, lean, padded)
    return j.done("chair")


def _back(
    j: Joinery,
    frame: Material,
    filling: Material,
    x: float,
    y: float,
    z: float,
    high: float,
    lean: float,
    padded: bool,
) -> None:
    """A chair's leaning back from the seat at z up to `high`."""
    rng, thick = j.rng, 0.016
    rise = high - z
    tilt = -float(np.arctan2(lean, rise))
    foot = y - 0.02
    kind = rng.choice(["slats", "rungs", "panel", "rods"])
    if kind != "panel":
        for side in (-1, 1):
            post = [[side * (x - 0.02), foot, z - 0.04], [side * (x - 0.012), foot + lean, high]]
            j.add(frame, stick(post[0], post[1], thick, 8))
    if kind == "slats" or kind == "rods":
        crown = slab(
            (x - 0.005, 0.045), 0.02, [[(0.0, 0.0), (0.0, 0.018)], [(0.0, 0.018), (0.004, 0.022)]], 2
        )
        j.add(filling, crown, (0, foot + lean + 0.005, high - 0.04), tilt=np.pi / 2 + tilt)
        for px in np.linspace(-x + 0.07, x - 0.07, 4 if kind == "slats" else 6).tolist():
            if kind == "rods":
                j.add(frame, stick([px, foot, z - 0.01], [px, foot + 0.95 * lean, high - 0.05], 0.007, 6))
            else:
                slat = board((0.035, 0.012, rise - 0.05), 0.002)
                j.add(frame, slat, (px, foot, z - 0.012), tilt=tilt)
    elif kind == "rungs":
        for share in np.linspace(0.38, 0.93, int(rng.integers(2, 5))).tolist():
            rung = slab((x - 0.012, 0.035), 0.012, [[(0.0, 0.0), (0.0, 0.016)]], 2)
            j.add(filling, rung, (0, foot + share * lean + 0.008, z + share * rise), tilt=np.pi / 2 + tilt)
    else:
        low = float(rng.uniform(0.0, 0.3)) * rise
        deep = 0.04 if padded else 0.014
        half = (rise - low) / 2
        panel = cushion((x - 0.005, half), deep, min(0.05, half * 0.9), 3)
        j.add(filling, panel, (0, foot + lean / 2 + deep / 2, z + low + half), tilt=np.pi / 2 + tilt)
        if low > 0:
            for side in (-1, 1):
                post = [
                    [side * (x - 0.06), foot, z - 0.03],
                    [side * (x - 0.06), foot + 0.8 * lean, high - 0.06],
                ]
                j.add(frame, stick(post[0], post[1], 0.012, 6))


@family
def stool(rng: np.random.Generator) -> Furniture:
    """A stool, round or square."""
    return _stool(rng, float(rng.uniform(0.43, 0.48)), "stool")


@family
def bar_stool(rng: np.random.Generator) -> Furniture:
    """A high stool for a counter."""
    return _stool(rng, float(rng.uniform(0.62, 0.7)), "bar_stool")


def _stool(rng: np.random.Generator, z: float, family: str) -> Furniture:
    j = Joinery(rng)
    half, padded = float(rng.uniform(0.15, 0.19)), rng.uniform() < 0.35
    radius = half if rng.uniform() < 0.6 else 0.02
    stuff = finishes.fabric(rng) if padded else finishes.wood(rng)
    if padded:
        j.add(stuff, cushion((half, half), 0.06, max(radius, 0.025), 5), (0, 0, z - 0.06))
    else:
        j.add(stuff, slab((half, half), radius, [[(0.0, z - 0.03), *rounding(0.01, z - 0.01, z, 2)]], 5))
    reach = (half - 0.03) * (0.7 if radius == half else 1.0) - 0.005
    j.support("display", (-reach, -reach), (reach, reach), z)
    frame = finishes.carcass(rng) if rng.uniform() < 0.6 else finishes.fitting(rng)
    under = z - (0.06 if padded else 0.03)
    foot, lean = half * (0.78 if radius == half else 1.0), 0.1
    splayed(j, frame, (foot, foot), under, 0.03, lean)
    for level in (0.3 * z, 0.42 * z):
        reach = foot - lean * level
        for side in (-1, 1):
            ends = np.array([[-reach, side * reach, level], [reach, side * reach, level]])
            ends = ends if level < 0.35 * z else ends[:, [1, 0, 2]]
            j.add(frame, stick(ends[0], ends[1], 0.009, 6))
    return j.done(family)


def _lounge(rng: np.random.Generator, family: str, places: int) -> Furniture:
    """An armchair or a sofa: a base, arms, a back, loose cushions."""
    j = Joinery(rng)
    seat, deep, arm = (float(value) for value in rng.uniform([0.43, 0.29, 0.07], [0.48, 0.34, 0.13]))
    place = float(rng.uniform(0.55, 0.65) if places > 1 else rng.uniform(0.52, 0.62))
    back, arms = float(rng.uniform(0.76, 0.92)), float(rng.uniform(0.56, 0.66))
    cover, foot = finishes.fabric(rng), float(rng.uniform(0.06, 0.16))
    inner, thick, y1 = place * places / 2, float(rng.uniform(0.12, 0.2)), deep + 0.02
    x = inner + arm
    y0 = y1 - 2 * deep - thick
    pad = float(rng.uniform(0.12, 0.17))
    r = float(rng.uniform(0.02, 0.05))

    def block(low: tuple[float, float, float], high: tuple[float, float, float], round_: float) -> None:
        a, b = np.array(low), np.array(high)
        half = (b - a) / 2
        j.add(
            cover,
            cushion(half[:2], b[2] - a[2], min(round_, 0.9 * half[:2].min()), 2),
            ((a[0] + b[0]) / 2, (a[1] + b[1]) / 2, a[2]),
        )

    block((-inner, y0 + 0.02, foot), (inner, y1 - 0.01, seat - pad), 0.02)
    for side in (-1, 1):
        a, b = sorted((side * inner, side * x))
        block((a, y0, foot), (b, y1, arms), max(r, 0.3 * arm))
    block((-inner, y1 - thick, seat - pad), (inner, y1, back - 0.06), r)
    loose = places > 1 and rng.uniform() < 0.7
    for k in range(places):
        a = -inner + k * place
        block((a + 0.003, y0 - 0.01, seat - pad), (a + place - 0.003, y1 - thick - 0.02, seat), 0.045)
        front = y1 - thick - 0.02
        pillow = cushion((place / 2 - 0.005, (back - seat) / 2), 0.13, 0.06, 3)
        j.add(cover, pillow, (a + place / 2, front + 0.02, (back + seat) / 2 + 0.002), tilt=np.pi / 2 - 0.16)
        lean = 0.34 if loose and k in (0, places - 1) else 0.16 + 0.16 * (back - seat) / 2
        j.support("reading", (a + 0.055, y0 + 0.045), (a + place - 0.055, front - lean), seat, behind=0.02)
    if loose:
        own = finishes.fabric_own(rng)
        for side in (-1, 1):
            pillow = cushion((0.2, 0.2), 0.11, 0.05, 3)
            j.add(
                own,
                pillow,
                (side * (inner - 0.23), y1 - thick - 0.17, seat + 0.2),
                side * 0.25,
                np.pi / 2 - 0.3,
            )
    if arm > 0.1 and min(arm / 2, 0.3 * arm) > 0.02:
        flat = 0.3 * arm if arm > 0.1 else r
        for side in (-1, 1):
            a, b = sorted((side * (inner + flat), side * (x - flat)))
            j.support("drinks", (a, y0 + 0.1), (b, y1 - 0.1), arms)
    wood = finishes.carcass(rng)
    for px in (0.05 - x, x - 0.05):
        for py in (y0 + 0.05, y1 - 0.05):
            j.add(wood, slab((0.025, 0.025), 0.025, [[(0.01, 0.0), (0.0, foot)]], 2), (px, py, 0))
    return j.done(family)


@family
def armchair(rng: np.random.Generator) -> Furniture:
    """An upholstered chair for one."""
    return _lounge(rng, "armchair", 1)


@family
def sofa(rng: np.random.Generator) -> Furniture:
    """A sofa for two or three."""
    return _lounge(rng, "sofa", int(rng.integers(2, 4)))


@family
def bench(rng: np.random.Generator) -> Furniture:
    """A plain bench, with or without a cushion."""
    j = Joinery(rng)
    x, y, z = (float(value) for value in rng.uniform([0.45, 0.15, 0.43], [0.7, 0.2, 0.47]))
    wood, padded = finishes.carcass(rng), rng.uniform() < 0.35
    under = z - 0.04 if padded else z
    thick = float(rng.uniform(0.025, 0.04))
    b = 0.004
    j.add(
        wood, slab((x, y), 0.006, [[(0.0, under - thick), (0.0, under - b)], [(0.0, under - b), (b, under)]])
    )
    if padded:
        j.add(finishes.fabric(rng), cushion((x - 0.01, y - 0.01), 0.04, 0.03), (0, 0, under))
    j.support("reading", (0.05 - x, 0.05 - y), (x - 0.05, y - 0.05), z)
    legs(j, wood, (x - 0.06, y - 0.04), under - thick, 0.05, str(rng.choice(LEGS)))
    j.board(wood, (0.06 - x, -0.012, 0.5 * z - 0.04), (x - 0.06, 0.012, 0.5 * z))
    for side in (-1, 1):
        px = side * (x - 0.06)
        j.board(wood, (px - 0.012, 0.04 - y, 0.5 * z - 0.04), (px + 0.012, y - 0.04, 0.5 * z))
    return j.done("bench")


@family
def window_seat(rng: np.random.Generator) -> Furniture:
    """A chest under a window with a long cushion on it."""
    j = Joinery(rng)
    x, y, z = (float(value) for value in rng.uniform([0.55, 0.22, 0.43], [0.85, 0.28, 0.48]))
    wood, pad = finishes.carcass(rng, 0.6), 0.06
    j.board(wood, (-x, 0.02 - y, 0.0), (x, y, z - pad), 0.002)
    count = 3 if x > 0.7 else 2
    edges = np.linspace(-x, x, count + 1).tolist()
    for a, b in zip(edges[:-1], edges[1:], strict=True):
        frame = 0.06
        for s, e in ((a, a + frame), (b - frame, b)):
            j.board(wood, (s, -y, 0.08), (e, 0.02 - y, z - pad - 0.02))
        for s, e in ((0.08, 0.08 + frame), (z - pad - 0.08, z - pad - 0.02)):
            j.board(wood, (a + frame, -y, s), (b - frame, 0.02 - y, e))
    j.board(wood, (-x - 0.01, -y - 0.01, z - pad - 0.02), (x + 0.01, y, z - pad), 0.004)
    j.add(finishes.fabric(rng), cushion((x - 0.01, y - 0.01), pad, 0.03), (0, 0, z - pad))
    j.support("reading", (0.06 - x, 0.06 - y), (x - 0.06, y - 0.06), z)
    return j.done("window_seat")
