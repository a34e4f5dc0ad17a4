"""Storage furniture: shelves, cabinets, chests, wardrobes, a mantelpiece."""

from __future__ import annotations

import numpy as np

from vig_world.assets.furniture import finishes
from vig_world.assets.furniture.fronts import FRONTS, HANDLES, fronts, leg, legs
from vig_world.assets.furniture.furniture import Furniture, family
from vig_world.assets.furniture.joinery import Joinery, boards, rounding, slab
from vig_world.assets.furniture.tables import edge
from vig_world.assets.props.material import Material
from vig_world.assets.textures import colour
from vig_world.mesh import Mesh

Corner = tuple[float, float, float]


def _style(rng: np.random.Generator) -> tuple[str, str]:
    return str(rng.choice(FRONTS)), str(rng.choice(HANDLES))


def _shell(j: Joinery, stuff: Material, low: Corner, high: Corner, wall: float = 0.018) -> None:
    """A cabinet open to the front: sides, bottom, top and a back."""
    (x0, y0, z0), (x1, y1, z1) = low, high
    j.board(stuff, (x0, y0, z0), (x0 + wall, y1, z1), 0.0015)
    j.board(stuff, (x1 - wall, y0, z0), (x1, y1, z1), 0.0015)
    j.board(stuff, (x0 + wall, y0, z0), (x1 - wall, y1, z0 + wall))
    j.board(stuff, (x0 + wall, y0, z1 - wall), (x1 - wall, y1, z1))
    j.board(stuff, (x0 + wall, y1 - 0.008, z0 + wall), (x1 - wall, y1, z1 - wall))


def _palette(rng: np.random.Generator) -> Material:
    """The covers of a row of books: a texture of 16 colours."""
    covers = np.array([colour(rng) for _ in range(16)], np.float32).reshape(4, 4, 3)
    return Material(0.8 * covers, "paper", 0.7)


def _books(j: Joinery, covers: Material, low: Corner, high: Corner) -> float:
    """A row of upright books from the left end of a shelf's clear opening; returns where it ends."""
    (x, y0, z), (x1, y1, z1) = low, high
    rng = j.rng
    lows, highs, swatches = [], [], []
    end = x + float(rng.uniform(0.35, 1.0)) * (x1 - x)
    tall = min(float(rng.uniform(0.2, 0.3)), z1 - z - 0.02)
    while True:
        wide, drop, depth = rng.uniform([0.016, 0.7, 0.11], [0.05, 1.0, 0.19]).tolist()
        if x + wide > end:
            break
        lows.append((x, max(y1 - 0.005 - depth, y0 + 0.005), z))
        highs.append((x + wide - 0.0005, y1 - 0.005, z + drop * tall))
        swatches.append((rng.integers(4, size=2) + 0.5) / 4)
        x += wide
    if lows:
        mesh = boards(lows, highs, 0.0, np.zeros((len(lows), 2)))
        uv = np.repeat(np.array(swatches), len(mesh.vertices) // len(lows), 0).astype(np.float32)
        j.add(covers, Mesh(mesh.vertices, mesh.faces, uv))
    return x


def _shelves(
    j: Joinery,
    stuff: Material,
    low: Corner,
    high: Corner,
    levels: list[float],
    zones: tuple[str, ...],
    covers: Material | None = None,
) -> None:
    """Boards between two uprights, each with what is free above it; the first level is a bottom that exists.

    low, high: the clear opening, its back closed. covers: what books are bound in that fill some of it.
    """
    (x0, y0, _), (x1, y1, z1) = low, high
    thick = 0.02
    for k, level in enumerate(levels):
        if k:
            j.board(stuff, (x0, y0 + 0.004, level - thick), (x1, y1, level), 0.0015)
        room = (levels[k + 1] - thick if k + 1 < len(levels) else z1) - level
        start = x0
        if covers is not None and room > 0.2 and j.rng.uniform() < 0.5:
            start = _books(j, covers, (x0, y0, level), (x1, y1, level + room))
        if room > 0.14:
            j.support(
                str(j.rng.choice(zones)),
                (start + 0.005, y0 + 0.012),
                (x1 - 0.005, y1 - 0.01),
                level,
                room,
                0.01,
            )


@family
def bookshelf(rng: np.random.Generator) -> Furniture:
    """Bookcase of one or two bays."""
    j = Joinery(rng)
    wide, deep = float(rng.uniform(0.32, 0.6)), float(rng.uniform(0.13, 0.17))
    high, plinth, wall = float(rng.uniform(1.1, 2.05)), float(rng.uniform(0.05, 0.09)), 0.02
    stuff, covers = finishes.carcass(rng), _palette(rng)
    _shell(j, stuff, (-wide, -deep, plinth), (wide, deep, high), wall)
    j.board(stuff, (-wide + 0.01, -deep + 0.02, 0.0), (wide - 0.01, deep - 0.01, plinth))
    bays = 2 if wide > 0.42 else 1
    edges = np.linspace(wall - wide, wide - wall, bays + 1).tolist()
    for a, b in zip(edges[:-1], edges[1:], strict=True):
        left = a + (0.01 if a > wall - wide else 0.0)
        right = b - (0.01 if b < wide - wall else 0.0)
        count = max(2, round((high - plinth) / rng.uniform(0.3, 0.42)))
        levels = np.linspace(plinth + wall, high - wall + 0.02, count + 1)[:-1]
        levels[1:] += rng.uniform(-0.03, 0.03, count - 1)
        _shelves(
            j,
            stuff,
            (left, -deep, plinth),
            (right, deep - 0.008, high - wall),
            levels.tolist(),
            ("reading", "display", "storage"),
            covers,
        )
    for middle in edges[1:-1]:
        j.board(
            stuff, (middle - 0.01, -deep + 0.002, plinth + wall), (middle + 0.01, deep - 0.008, high - wall)
        )
    if high < 1.5:
        j.support("display", (0.01 - wide, 0.01 - deep), (wide - 0.01, deep - 0.01), high)
    return j.done("bookshelf")


@family
def wall_shelf(rng: np.random.Generator) -> Furniture:
    """One to three boards on brackets, hung on a wall by whoever places it; its lowest board is at z = 0."""
    j = Joinery(rng)
    x, y = float(rng.uniform(0.35, 0.7)), float(rng.uniform(0.09, 0.14))
    board, metal = finishes.carcass(rng, 0.15), finishes.fitting(rng)
    thick, count = float(rng.uniform(0.018, 0.036)), int(rng.choice([1, 1, 2, 3]))
    step = float(rng.uniform(0.28, 0.38))
    kind = int(rng.integers(3))
    for k in range(count):
        z = k * step + thick
        low, high = [[-x, -y, z - thick]], [[x, y, z]]
        j.add(board, boards(low, high, float(rng.choice([0.0015, 0.004])), rng.uniform(0, 1, (1, 2))))
        room = step - thick - (0.13 if kind == 0 else 0.0) if k + 1 < count else float("inf")
        j.support("display", (0.015 - x, 0.01 - y), (x - 0.015, y - 0.02), z, room, 0.02)
        for side in (-0.72 * x, 0.72 * x):
            if kind == 0:  # brackets of iron below
                j.board(metal, (side - 0.008, y - 0.006, z - thick - 0.13), (side + 0.008, y, z - thick))
                j.board(
                    metal, (side - 0.008, 0.02 - y, z - thick - 0.006), (side + 0.008, y - 0.006, z - thick)
                )
    if kind == 1 and count > 1:  # rails up the wall
        for side in (-0.72 * x, 0.72 * x):
            j.board(metal, (side - 0.01, y - 0.004, -0.05), (side + 0.01, y + 0.012, count * step))
    if kind == 2 and count > 1:  # upright ends
        for side in (-x - 0.018, x):
            j.board(board, (side, -y, 0.0), (side + 0.018, y, (count - 1) * step + thick), 0.0015)
    return j.done("wall_shelf")


@family
def sideboard(rng: np.random.Generator) -> Furniture:
    """A long low cabinet with doors and drawers."""
    j = Joinery(rng)
    x, y = float(rng.uniform(0.55, 0.9)), float(rng.uniform(0.2, 0.25))
    z, foot = float(rng.uniform(0.7, 0.9)), float(rng.uniform(0.06, 0.2))
    top, body, metal = finishes.top(rng), finishes.carcass(rng), finishes.fitting(rng)
    thick = float(rng.uniform(0.018, 0.035))
    under = z - thick
    j.add(top, slab((x + 0.01, y + 0.01), 0.005, edge(rng, under, z)))
    margin = 0.5 * thick + 0.01
    j.support("display", (margin - x, margin - y), (x - margin, y - margin), z)
    j.board(body, (-x, 0.018 - y, foot), (x, y, under))
    face = 0.018 - y
    style, columns = _style(rng), int(rng.integers(2, 5))
    niche = rng.uniform() < 0.35
    split = under - float(rng.uniform(0.14, 0.2)) if rng.uniform() < 0.6 else under
    if split < under and not niche:
        fronts(j, body, metal, (-x, split), (x, under), face, [1.0], columns, ("flat", style[1]))
    fronts(j, body, metal, (-x, foot), (x, split if not niche else under), face, [1.0], columns, style)
    if foot > 0.1:
        legs(j, body, (x - 0.06, y - 0.06), foot, 0.045, str(rng.choice(["tapered", "round", "square"])))
    else:
        j.board(body, (0.02 - x, 0.05 - y, 0.0), (x - 0.02, y - 0.01, foot))
    return j.done("sideboard")


@family
def media_bench(rng: np.random.Generator) -> Furniture:
    """A low cabinet with an open niche, as for a television."""
    j = Joinery(rng)
    x, y = float(rng.uniform(0.6, 0.9)), float(rng.uniform(0.18, 0.22))
    z, foot = float(rng.uniform(0.4, 0.55)), 0.08
    top, body, metal = finishes.top(rng), finishes.carcass(rng), finishes.fitting(rng)
    under = z - 0.022
    j.add(top, slab((x, y), 0.004, edge(rng, under, z)))
    j.support("display", (0.02 - x, 0.02 - y), (x - 0.02, y - 0.02), z)
    a = float(rng.uniform(0.25, 0.45)) * x
    for s, e in ((-x + 0.005, -a), (a, x - 0.005)):
        j.board(body, (s, 0.018 - y, foot), (e, y, under))
        fronts(j, body, metal, (s, foot), (e, under), 0.018 - y, [1.0, 1.0], 1, _style(rng))
    j.board(body, (-a, 0.0 - y, foot), (a, y, foot + 0.018))
    j.board(body, (-a, y - 0.008, foot + 0.018), (a, y, under))
    low = foot + 0.018
    j.support("storage", (0.01 - a, 0.015 - y), (a - 0.01, y - 0.02), low, under - low, 0.012)
    for px in (0.08 - x, x - 0.08):
        j.board(body, (px - 0.02, 0.04 - y, 0.0), (px + 0.02, y - 0.04, foot))
    return j.done("media_bench")


@family
def chest_of_drawers(rng: np.random.Generator) -> Furniture:
    """Drawers above one another."""
    j = Joinery(rng)
    x, y = float(rng.uniform(0.35, 0.55)), float(rng.uniform(0.2, 0.26))
    z, foot = float(rng.uniform(0.75, 1.1)), float(rng.uniform(0.05, 0.14))
    top, body, metal = finishes.top(rng), finishes.carcass(rng), finishes.fitting(rng)
    thick = float(rng.uniform(0.018, 0.03))
    under = z - thick
    j.add(top, slab((x + 0.012, y + 0.012), 0.005, edge(rng, under, z)))
    margin = 0.5 * thick + 0.005
    j.support("display", (margin - x, margin - y), (x - margin, y - margin), z)
    j.board(body, (-x, 0.018 - y, foot), (x, y, under), 0.002)
    rows = [1.35] + [1.2] * int(rng.integers(1, 3)) + [1.0]
    style = _style(rng)
    columns = 2 if x > 0.45 and rng.uniform() < 0.5 else 1
    fronts(j, body, metal, (0.02 - x, foot + 0.02), (x - 0.02, under - 0.01), 0.018 - y, rows, columns, style)
    legs(j, body, (x - 0.035, y - 0.04), foot, 0.06, str(rng.choice(["square", "tapered", "round"])))
    return j.done("chest_of_drawers")


@family
def bedside_table(rng: np.random.Generator) -> Furniture:
    """A drawer with an open niche below."""
    j = Joinery(rng)
    x, y, z = (float(value) for value in rng.uniform([0.2, 0.18, 0.45], [0.27, 0.22, 0.6]))
    body, metal = finishes.carcass(rng), finishes.fitting(rng)
    foot, under = float(rng.uniform(0.05, 0.18)), z - 0.02
    j.add(finishes.top(rng), slab((x, y), 0.006, edge(rng, under, z)))
    j.support("bedside", (0.015 - x, 0.015 - y), (x - 0.015, y - 0.015), z)
    split = under - float(rng.uniform(0.12, 0.16))
    _shell(j, body, (0.005 - x, 0.022 - y, foot), (x - 0.005, y - 0.002, split))
    j.board(body, (0.005 - x, 0.022 - y, split), (x - 0.005, y - 0.002, under))
    fronts(j, body, metal, (0.005 - x, split), (x - 0.005, under), 0.022 - y, [1.0], 1, _style(rng))
    low = foot + 0.018
    room = split - 0.018 - low
    if room > 0.12:
        j.support("bedside", (0.035 - x, 0.035 - y), (x - 0.035, y - 0.015), low, room, 0.012)
    legs(j, body, (x - 0.03, y - 0.03), foot, 0.035, str(rng.choice(["square", "tapered", "round"])))
    return j.done("bedside_table")


@family
def wardrobe(rng: np.random.Generator) -> Furniture:
    """Two or three tall doors."""
    j = Joinery(rng)
    columns = int(rng.integers(2, 4))
    x, y = 0.25 * columns + float(rng.uniform(-0.03, 0.05)), float(rng.uniform(0.28, 0.32))
    z, foot = float(rng.uniform(1.85, 2.15)), 0.08
    body, metal = finishes.carcass(rng), finishes.fitting(rng)
    j.board(body, (-x, 0.018 - y, foot), (x, y, z - 0.02), 0.002)
    j.board(body, (0.02 - x, 0.05 - y, 0.0), (x - 0.02, y - 0.01, foot))
    j.board(body, (-x - 0.01, -0.005 - y, z - 0.03), (x + 0.01, y, z), 0.004)
    drawers = foot + 0.25 if rng.uniform() < 0.4 else foot
    style = _style(rng)
    if drawers > foot:
        fronts(j, body, metal, (-x, foot), (x, drawers), 0.018 - y, [1.0], columns, style)
    fronts(j, body, metal, (-x, drawers), (x, z - 0.03), 0.018 - y, [1.0], columns, style)
    return j.done("wardrobe")


@family
def dresser(rng: np.random.Generator) -> Furniture:
    """A sideboard with plate shelves above its back."""
    j = Joinery(rng)
    x, y = float(rng.uniform(0.45, 0.7)), float(rng.uniform(0.21, 0.25))
    z, high = float(rng.uniform(0.8, 0.9)), float(rng.uniform(1.75, 2.0))
    top, body, metal = finishes.top(rng), finishes.carcass(rng, 0.4), finishes.fitting(rng)
    under, foot, back = z - 0.03, 0.08, y - float(rng.uniform(0.18, 0.22))
    j.add(top, slab((x + 0.015, y), 0.005, edge(rng, under, z)))
    j.board(body, (-x, 0.03 - y, foot), (x, y, under))
    j.board(body, (0.02 - x, 0.06 - y, 0.0), (x - 0.02, y - 0.01, foot))
    style = _style(rng)
    columns = 2 if x < 0.6 else 3
    fronts(j, body, metal, (-x, under - 0.16), (x, under), 0.03 - y, [1.0], columns, ("flat", style[1]))
    fronts(j, body, metal, (-x, foot), (x, under - 0.16), 0.03 - y, [1.0], columns, style)
    wall = 0.02
    for side in (-x, x - wall):
        j.board(body, (side, back, z), (side + wall, y, high), 0.0015)
    j.board(body, (wall - x, y - 0.01, z), (x - wall, y, high))
    j.add(
        body,
        slab((x + 0.02, (y - back) / 2 + 0.02), 0.004, [[(0.02, 0.0), *rounding(0.0, 0.01, 0.03, 1)]]),
        (0, (y + back) / 2 - 0.02, high),
    )
    first = z + float(rng.uniform(0.32, 0.45))
    levels = np.linspace(first, high, 3).tolist()[:2]
    j.support("display", (0.02 - x, 0.02 - y), (x - 0.02, back - 0.01), z, high - z)
    inner = [z, *levels]
    _shelves(j, body, (wall - x, back, z), (x - wall, y - 0.01, high), inner, ("display", "storage"))
    return j.done("dresser")


@family
def fireplace(rng: np.random.Generator) -> Furniture:
    """A chimney-piece with its mantel."""
    j = Joinery(rng)
    x, y = float(rng.uniform(0.6, 0.75)), float(rng.uniform(0.1, 0.15))
    z, thick = float(rng.uniform(1.05, 1.25)), float(rng.uniform(0.03, 0.06))
    stone = finishes.carcass(rng, 0.75)
    under = z - thick
    j.add(stone, slab((x + 0.05, y + 0.01), 0.004, edge(rng, under, z)))
    j.support("display", (-x, 0.02 - y), (x, y - 0.02), z)
    wide, deep = float(rng.uniform(0.14, 0.2)), y - 0.03
    for side in (-x, x - wide):
        j.board(stone, (side, -deep, 0.0), (side + wide, y, under), 0.004)
        j.board(stone, (side - 0.015, -deep - 0.015, 0.0), (side + wide + 0.015, y, 0.14), 0.004)
        j.board(stone, (side + 0.035, -deep - 0.008, 0.2), (side + wide - 0.035, -deep, under - 0.28), 0.004)
    lintel = under - float(rng.uniform(0.18, 0.26))
    j.board(stone, (-x + wide, -deep + 0.01, lintel), (x - wide, y, under), 0.004)
    dark = finishes.plain((0.03, 0.028, 0.026), "brick", 0.9)
    j.board(dark, (-x + wide, y - 0.03, 0.0), (x - wide, y, lintel))
    iron = finishes.plain((0.05, 0.05, 0.052), "metal", 0.5)
    grate = 0.5 * (x - wide)
    j.board(iron, (-grate, 0.0, 0.1), (grate, y - 0.04, 0.12))
    for px in np.linspace(-grate, grate, 7).tolist():
        j.board(iron, (px - 0.006, -0.012, 0.06), (px + 0.006, 0.0, 0.22))
    for px in (-grate, grate - 0.02):
        leg(j, iron, px, 0.02, 0.1, 0.02, "square")
    return j.done("fireplace")
