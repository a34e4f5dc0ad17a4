"""Doors, drawers and their handles, and legs: what storage and tables have in common."""

from __future__ import annotations

import numpy as np

from vig_world.assets.furniture.joinery import Joinery, rounding, slab, stick, turned_post
from vig_world.assets.props.material import Material

HANDLES = ("bar", "knob", "cup", "none")
FRONTS = ("flat", "flat", "shaker", "slatted")
LEGS = ("square", "tapered", "round", "turned")
THICK = 0.018
"""Metres of a front's board."""


def handle(
    j: Joinery, stuff: Material, kind: str, at: tuple[float, float, float], upright: bool, length: float
) -> None:
    """A handle whose foot is at a point of a front that faces -Y."""
    x, y, z = at
    if kind == "bar":
        half = length / 2
        reach = (0.006, half) if upright else (half, 0.006)
        j.board(
            stuff, (x - reach[0], y - 0.034, z - reach[1]), (x + reach[0], y - 0.024, z + reach[1]), 0.003
        )
        for side in (-0.8 * half, 0.8 * half):
            px, pz = (x, z + side) if upright else (x + side, z)
            j.board(stuff, (px - 0.005, y - 0.028, pz - 0.005), (px + 0.005, y, pz + 0.005))
    elif kind == "knob":
        profile = [(0.008, 0.0), (0.0, 0.016), (0.0, 0.022), (0.006, 0.028)]
        j.add(stuff, slab((0.015, 0.015), 0.015, [profile], 2, soft=True), (x, y, z), tilt=np.pi / 2)
    elif kind == "cup":
        j.add(
            stuff,
            slab((0.04, 0.015), 0.012, [[(0.0, 0.0), *rounding(0.01, 0.012, 0.024, 1)]], 1, soft=True),
            (x, y, z),
            tilt=np.pi / 2,
        )


def front(
    j: Joinery, stuff: Material, low: tuple[float, float], high: tuple[float, float], y: float, kind: str
) -> None:
    """One door or drawer front between (x, z) corners, in front of the plane y."""
    (x0, z0), (x1, z1) = low, high
    if kind == "flat" or min(x1 - x0, z1 - z0) < 0.16:
        j.board(stuff, (x0, y - THICK, z0), (x1, y, z1), 0.0025)
    elif kind == "shaker":
        rail = min(0.07, 0.25 * min(x1 - x0, z1 - z0))
        j.board(stuff, (x0 + rail, y - 0.008, z0 + rail), (x1 - rail, y, z1 - rail))
        for a, b in ((x0, x0 + rail), (x1 - rail, x1)):
            j.board(stuff, (a, y - THICK, z0), (b, y, z1))
        for a, b in ((z0, z0 + rail), (z1 - rail, z1)):
            j.board(stuff, (x0 + rail, y - THICK, a), (x1 - rail, y, b))
    else:
        count = max(2, round((x1 - x0) / 0.09))
        edges = np.linspace(x0, x1, count + 1)
        for a, b in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True):
            j.board(stuff, (a + 0.001, y - THICK, z0), (b - 0.001, y, z1))


def fronts(
    j: Joinery,
    stuff: Material,
    metal: Material,
    low: tuple[float, float],
    high: tuple[float, float],
    y: float,
    rows: list[float],
    columns: int,
    style: tuple[str, str],
) -> None:
    """A field of drawers (several rows) or doors (one row) that faces -Y.

    Args:
        low: (x, z) corners.
        high: (x, z) corners.
        rows: Relative heights from the bottom.
        style: Kinds of front and handle.
    """
    xs = np.linspace(low[0], high[0], columns + 1).tolist()
    zs = (low[1] + (high[1] - low[1]) * np.concatenate([[0], np.cumsum(rows)]) / np.sum(rows)).tolist()
    for column in range(columns):
        for row in range(len(rows)):
            a = (xs[column] + 0.0015, zs[row] + 0.0015)
            b = (xs[column + 1] - 0.0015, zs[row + 1] - 0.0015)
            front(j, stuff, a, b, y, style[0])
            width, height = b[0] - a[0], b[1] - a[1]
            if height > 1.1 * width or (len(rows) == 1 and height > 0.3):
                left = column % 2 == 1 if columns > 1 else True
                x = a[0] + 0.04 if left else b[0] - 0.04
                z = b[1] - 0.12 if b[1] < 1.2 else (a[1] + b[1]) / 2
                handle(j, metal, "knob" if style[1] == "cup" else style[1], (x, y - THICK, z), True, 0.14)
            else:
                length = min(0.16, 0.5 * width)
                for x in np.linspace(a[0], b[0], 4)[1:3] if width > 0.8 else [(a[0] + b[0]) / 2]:
                    handle(j, metal, style[1], (float(x), y - THICK, (a[1] + b[1]) / 2), False, length)


def leg(j: Joinery, stuff: Material, x: float, y: float, z: float, thick: float, kind: str) -> None:
    """One leg from the floor to z, `thick` metres wide at its top."""
    half = thick / 2
    if kind == "square":
        j.board(stuff, (x - half, y - half, 0.0), (x + half, y + half, z), 0.002)
    elif kind == "tapered":
        j.add(stuff, slab((half, half), 0.0, [[(0.45 * half, 0.0), (0.0, 0.85 * z), (0.0, z)]], 0), (x, y, 0))
    elif kind == "round":
        j.add(stuff, slab((half, half), half, [[(0.5 * half, 0.0), (0.0, z)]], 2), (x, y, 0))
    else:
        r = np.array([0, 0.45, 0.7, 0.5, 0.95, 0.6, 1.0, 1.0, 0]) * half
        h = np.array([0, 0, 0.05, 0.12, 0.68, 0.74, 0.8, 1.0, 1.0]) * z
        j.add(stuff, turned_post(np.stack([r, h], -1), 8), (x, y, 0))


def legs(j: Joinery, stuff: Material, half: tuple[float, float], z: float, thick: float, kind: str) -> None:
    """Four legs whose centres are at the corners (+-x, +-y)."""
    for x in (-half[0], half[0]):
        for y in (-half[1], half[1]):
            leg(j, stuff, x, y, z, thick, kind)


def hoops(j: Joinery, stuff: Material, half: tuple[float, float], z: float, thick: float) -> None:
    """Two frames of square tube, at each end one, as modern tables have."""
    t = thick / 2
    for x in (-half[0], half[0]):
        for y in (-half[1], half[1]):
            j.board(stuff, (x - t, y - t, 0.0), (x + t, y + t, z))
        for low in (0.0, z - thick):
            j.board(stuff, (x - t, -half[1] + t, low), (x + t, half[1] - t, low + thick))


def splayed(
    j: Joinery, stuff: Material, half: tuple[float, float], z: float, thick: float, lean: float = 0.08
) -> None:
    """Four round legs that lean outward by `lean` times their length, their feet at (+-x, +-y)."""
    for sx in (-1, 1):
        for sy in (-1, 1):
            foot = np.array([sx * half[0], sy * half[1], 0.0])
            head = foot + [-sx * lean * z, -sy * lean * z, z]
            j.add(stuff, stick(foot, head, thick / 2, 8))
