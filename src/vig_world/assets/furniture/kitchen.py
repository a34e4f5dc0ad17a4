"""Fitted kitchens: counters with sink or hob, islands, wall cupboards, refrigerators."""

from __future__ import annotations

import numpy as np

from vig_world.assets.furniture import finishes
from vig_world.assets.furniture.fronts import FRONTS, HANDLES, THICK, fronts, handle
from vig_world.assets.furniture.furniture import Furniture, family
from vig_world.assets.furniture.joinery import Joinery, rod, slab, stick, turned_post
from vig_world.assets.furniture.pierced import Hole, pierced
from vig_world.assets.furniture.tables import edge
from vig_world.assets.props.material import Material
from vig_world.mesh import Mesh

STEEL = (0.5, 0.5, 0.51)
WORKTOP, THICKNESS, WORKTOP_DEPTH = 0.91, 0.038, 0.62
"""Height, thickness and depth of worktops, metres: the same in all counters, which stand side by side."""


def _sink(j: Joinery, hole: Hole, z: float) -> None:
    """A basin whose rim lies on the worktop at z, and a tap behind it."""
    white = j.rng.uniform() < 0.25
    basin = (
        finishes.plain((0.8, 0.8, 0.77), "ceramic", 0.15) if white else finishes.plain(STEEL, "metal", 0.3)
    )
    stuff = finishes.fitting(j.rng) if j.rng.uniform() < 0.4 else finishes.plain(STEEL, "metal", 0.25)
    x, y = (hole[0] + hole[2]) / 2, (hole[1] + hole[3]) / 2
    half = np.array([hole[2] - hole[0], hole[3] - hole[1]]) / 2
    deep = float(j.rng.uniform(0.15, 0.2))
    j.add(
        basin,
        slab(
            half + 0.015,
            0.03,
            [
                [(0.019, z - deep - 0.002), (0.019, z)],
                [(0.019, z), (0.0, z)],
                [(0.0, z), (0.002, z + 0.003)],
                [(0.002, z + 0.003), (0.02, z + 0.003), (0.026, z - 0.006)],
                [(0.026, z - 0.006), (0.03, z - deep + 0.03), (0.05, z - deep)],
            ],
        ),
        (x, y, 0),
    )
    ring = slab((0.035, 0.035), 0.035, [[(0.0, 0.0), (0.0, 0.002)]], 3)
    j.add(finishes.plain((0.12, 0.12, 0.13), "metal", 0.3), ring, (x, y, z - deep))
    bend = np.linspace(0, np.pi, 5)
    reach, high = float(j.rng.uniform(0.07, 0.1)), float(j.rng.uniform(0.14, 0.24))
    back = hole[3] + 0.055
    path = [[x, back, z], *([x, back - reach * (1 - np.cos(a)), z + high + reach * np.sin(a)] for a in bend)]
    j.add(stuff, rod([*path, [x, back - 2 * reach, z + high - 0.03]], 0.011, 6, (1.0, 0.0, 0.0)))
    j.add(
        stuff,
        slab((0.026, 0.026), 0.026, [[(0.0, z), (0.0, z + 0.05)], [(0.0, z + 0.05), (0.008, z + 0.056)]]),
        (x, back, 0),
    )
    j.add(stuff, stick([x + 0.02, back, z + 0.04], [x + 0.1, back - 0.01, z + 0.06], 0.006, 6))


def _hob(j: Joinery, area: Hole, z: float) -> None:
    """A plate of black glass with rings, or burners with grates."""
    rng = j.rng
    x, y = (area[0] + area[2]) / 2, (area[1] + area[3]) / 2
    half = ((area[2] - area[0]) / 2, (area[3] - area[1]) / 2)
    black = finishes.plain((0.025, 0.025, 0.028), "glass", 0.08)
    gas = rng.uniform() < 0.45
    steel = finishes.plain(STEEL, "metal", 0.3)
    j.add(
        steel if gas else black,
        slab(half, 0.01, [[(0.0, z), (0.0, z + 0.004)], [(0.0, z + 0.004), (0.002, z + 0.006)]]),
        (x, y, 0),
    )
    iron = finishes.plain((0.04, 0.04, 0.042), "metal", 0.6)
    grey = finishes.plain((0.2, 0.2, 0.21), "glass", 0.2)
    for sx, sy, r in ((-1, -1, 0.09), (1, -1, 0.075), (-1, 1, 0.075), (1, 1, 0.09)):
        px, py = x + 0.5 * sx * half[0], y + 0.48 * sy * half[1]
        if not gas:
            ring = [(r - 0.003, 0.0), (r, 0.0), (r, 0.0008), (r - 0.003, 0.0008), (r - 0.003, 0.0)]
            j.add(grey, turned_post(ring, 20), (px, py, z + 0.006))
            continue
        j.add(
            iron,
            slab((0.5 * r, 0.5 * r), 0.5 * r, [[(0.0, 0.0), (0.0, 0.012)], [(0.0, 0.012), (0.008, 0.018)]]),
            (px, py, z + 0.006),
        )
        for along in (True, False):
            a, b = (0.115, 0.005) if along else (0.005, 0.115)
            j.board(iron, (px - a, py - b, z + 0.032), (px + a, py + b, z + 0.042))
        for a in (-0.11, 0.11):
            j.board(iron, (px + a - 0.005, py - 0.005, z + 0.006), (px + a + 0.005, py + 0.005, z + 0.032))


def _oven(j: Joinery, metal: Material, low: tuple[float, float], high: tuple[float, float], y: float) -> None:
    glass = finishes.plain((0.03, 0.03, 0.033), "glass", 0.1)
    steel = finishes.plain((0.45, 0.45, 0.46), "metal", 0.35)
    split = high[1] - 0.11
    j.board(steel, (low[0], y - THICK, split), (high[0], y, high[1]), 0.002)
    j.board(glass, (low[0], y - THICK, low[1] + 0.06), (high[0], y, split - 0.004), 0.003)
    j.board(steel, (low[0], y - THICK, low[1]), (high[0], y, low[1] + 0.056), 0.002)
    middle = (low[0] + high[0]) / 2
    handle(j, metal, "bar", (middle, y - THICK, split - 0.05), False, high[0] - low[0] - 0.1)
    for x in np.linspace(low[0] + 0.07, high[0] - 0.07, 5).tolist():
        j.add(
            metal,
            slab((0.017, 0.017), 0.017, [[(0.0, 0.0), (0.003, 0.018)]], 2),
            (x, y - THICK, (split + high[1]) / 2),
            tilt=np.pi / 2,
        )


def _units(j: Joinery, body: Material, metal: Material, x: float, y: float, under: float, oven: int) -> None:
    """Base units of about 0.6 m each below a worktop, their fronts at -y; unit `oven` is an oven."""
    rng, plinth = j.rng, 0.1
    j.board(body, (-x, 0.02 - y, plinth), (x, y, under))
    j.board(body, (-x + 0.01, 0.07 - y, 0.0), (x - 0.01, y - 0.01, plinth))
    edges = np.linspace(-x, x, max(2, round(2 * x / 0.6)) + 1).tolist()
    style = (str(rng.choice(FRONTS)), str(rng.choice(HANDLES)))
    for k, (a, b) in enumerate(zip(edges[:-1], edges[1:], strict=True)):
        low, high, face = (a, plinth), (b, under - 0.004), 0.02 - y
        kind = rng.integers(3)
        if k == oven:
            _oven(j, metal, (a + 0.002, plinth + 0.004), (b - 0.002, under - 0.006), face)
        elif kind == 0:
            fronts(j, body, metal, low, high, face, [2.0, 2.0, 1.0], 1, style)
        else:
            split = under - 0.15 if kind == 1 else under - 0.004
            if kind == 1:
                fronts(j, body, metal, (a, split), high, face, [1.0], 1, ("flat", style[1]))
            fronts(j, body, metal, low, (b, split), face, [1.0], 1, style)


@family
def kitchen_counter(rng: np.random.Generator) -> Furniture:
    """A run of base units under one worktop."""
    return _counter(rng, "kitchen_counter")


@family
def sink_counter(rng: np.random.Generator) -> Furniture:
    """A run of base units with a sink."""
    return _counter(rng, "sink_counter")


@family
def hob_counter(rng: np.random.Generator) -> Furniture:
    """A run of base units with a hob, most with an oven below it."""
    return _counter(rng, "hob_counter")


def _counter(rng: np.random.Generator, family: str) -> Furniture:
    j = Joinery(rng)
    count = int(rng.integers(2, 4 if family == "kitchen_counter" else 5))
    x, y, z = 0.3 * count, WORKTOP_DEPTH / 2, WORKTOP
    top, body, metal = finishes.top(rng), finishes.wood(rng), finishes.fitting(rng)
    under, lip = z - THICKNESS, 0.03
    middle = float(np.clip(-x + 0.6 * float(rng.integers(count)) + 0.3, 0.36 - x, x - 0.36))
    sink, hob = family == "sink_counter", family == "hob_counter"
    wide = float(rng.uniform(0.2, 0.27)) if sink else 0.285
    area = (middle - wide, -0.21, middle + wide, 0.19 if sink else 0.25)
    j.add(top, pierced((-x, lip - y), (x, y), under, z, [area] if sink else []))
    _nosing(j, top, x, -y - 0.012, lip - y, under, z)
    back, near = y - 0.005, 0.015 - y
    zone = "washing" if sink else "cooking"
    ends = [(0.015 - x, x - 0.015)]
    if sink or hob:
        ends = [(0.015 - x, middle - wide - 0.05), (middle + wide + 0.05, x - 0.015)]
    for a, b in ends:
        if b > a:
            j.support(zone, (a, near), (b, back), z, behind=0.005)
    if sink:
        _sink(j, area, z)
    elif hob:
        _hob(j, area, z)
    oven = int((middle + x) // 0.6) if hob and rng.uniform() < 0.8 else -1
    _units(j, body, metal, x, y, under, oven)
    return j.done(family)


def _nosing(j: Joinery, stuff: Material, x: float, y0: float, y1: float, low: float, high: float) -> None:
    """The front edge of a worktop: a bar along x whose edge is bevelled or rounded."""
    runs = edge(j.rng, low, high)
    outline = [(y1, low), *((y0 + inset, z) for run in runs for inset, z in run), (y1, high)]
    section = np.array([p for k, p in enumerate(outline) if k == 0 or p != outline[k - 1]])
    n = len(section)
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(section, axis=0).T))])
    points, uv, faces = [], [], []
    closed = [*range(n), 0]
    for k in range(n):
        (ya, za), (yb, zb) = section[closed[k]], section[closed[k + 1]]
        start = 4 * k
        points += [(-x, ya, za), (x, ya, za), (x, yb, zb), (-x, yb, zb)]
        if k == n - 2:  # the upper side, whose texture goes on into the board behind it
            uv += [(ya, -x), (ya, x), (yb, x), (yb, -x)]
        else:
            va, vb = along[k] + y0, (along[k + 1] if k + 1 < n else along[k] + 0.03) + y0
            uv += [(va, -x), (va, x), (vb, x), (vb, -x)]
        faces += [(start, start + 2, start + 1), (start, start + 3, start + 2)]
    for side in (-x, x):
        start = len(points)
        points += [(side, py, pz) for py, pz in section]
        uv += [(py, pz) for py, pz in section]
        fan = [(start, start + k, start + k + 1) for k in range(1, n - 1)]
        faces += fan if side < 0 else [face[::-1] for face in fan]
    mesh = Mesh(np.array(points, np.float32), np.array(faces, np.int32), np.array(uv, np.float32))
    a, b, c = (mesh.vertices[mesh.faces[:, i]].astype(float) for i in range(3))
    if np.einsum("fi,fi->", a, np.cross(b - a, c - a)) < 0:
        mesh = Mesh(mesh.vertices, np.ascontiguousarray(mesh.faces[:, ::-1]), mesh.uv)
    j.add(stuff, mesh)


@family
def kitchen_island(rng: np.random.Generator) -> Furniture:
    """A free counter whose top overhangs at the back, where one can sit."""
    j = Joinery(rng)
    x, y, z = (float(value) for value in rng.uniform([0.6, 0.38, 0.88], [0.95, 0.5, 0.94]))
    thick = float(rng.uniform(0.025, 0.05))
    under, body, metal = z - thick, finishes.carcass(rng), finishes.fitting(rng)
    j.add(finishes.top(rng), slab((x, y), float(rng.choice([0.005, 0.03])), edge(rng, under, z)))
    margin = 0.5 * thick + 0.02
    j.support("cooking", (margin - x, margin - y), (x - margin, y - margin), z)
    inner = Joinery(rng)
    overhang = float(rng.uniform(0.02, 0.25))
    half = y - 0.01 - overhang / 2
    _units(inner, body, metal, x - 0.03, half, under, -1)
    for mesh, stuff in inner.parts():
        j.add(stuff, mesh, (0, -overhang / 2, 0))
    return j.done("kitchen_island")


@family
def wall_cupboard(rng: np.random.Generator) -> Furniture:
    """Cupboards to be hung above a counter; some have an open shelf below."""
    j = Joinery(rng)
    count = int(rng.integers(2, 5))
    x, y, z = 0.3 * count, float(rng.uniform(0.15, 0.17)), float(rng.uniform(0.55, 0.72))
    body, metal = finishes.wood(rng), finishes.fitting(rng)
    low = 0.0
    if rng.uniform() < 0.3:
        low = 0.26
        j.board(body, (-x, -y, 0.0), (x, y, 0.02), 0.0015)
        j.board(body, (-x, y - 0.01, 0.02), (x, y, low))
        for side in (-x, x - 0.02):
            j.board(body, (side, -y, 0.02), (side + 0.02, y, low))
        j.support("storage", (0.03 - x, 0.015 - y), (x - 0.03, y - 0.02), 0.02, low - 0.02, 0.01)
    j.board(body, (-x, 0.018 - y, low), (x, y, low + z), 0.0015)
    style = (str(rng.choice(FRONTS)), str(rng.choice(HANDLES)))
    for a in np.linspace(-x, x, count + 1)[:-1].tolist():
        front_low, front_high = (a, low), (a + 0.6, low + z)
        fronts(j, body, metal, front_low, front_high, 0.018 - y, [1.0], 1, style)
    return j.done("wall_cupboard")


@family
def refrigerator(rng: np.random.Generator) -> Furniture:
    """A tall refrigerator with a freezer's door below."""
    j = Joinery(rng)
    x, y, z = (float(value) for value in rng.uniform([0.29, 0.3, 1.55], [0.34, 0.33, 1.9]))
    tone = rng.choice([0.78, 0.5, 0.06], p=[0.5, 0.35, 0.15])
    body = finishes.plain(
        np.full(3, tone) * rng.uniform(0.95, 1.0, 3), "metal" if tone < 0.7 else "plastic", 0.35
    )
    metal = finishes.fitting(rng)
    split = z * float(rng.uniform(0.32, 0.42))
    j.board(body, (-x, 0.05 - y, 0.02), (x, y, z), 0.004)
    for low, high in ((0.05, split - 0.004), (split + 0.004, z)):
        j.board(body, (-x, -y, low), (x, 0.045 - y, high), 0.008)
        at = high - 0.25 if low < 0.1 else low + 0.25
        handle(j, metal, "bar", (x - 0.05, -y, at), True, 0.36)
    j.board(finishes.plain((0.04, 0.04, 0.04)), (0.01 - x, 0.06 - y, 0.0), (x - 0.01, y - 0.01, 0.02))
    return j.done("refrigerator")
