"""Fittings: lamps, radiators, pictures, rugs, each in its own frame."""

from __future__ import annotations

import numpy as np

from vig_world.assets.furniture import finishes
from vig_world.assets.furniture.joinery import Joinery, slab, stick, turned_post
from vig_world.assets.props.material import label, material
from vig_world.mesh import Mesh
from vig_world.rooms.shell import Part


def pendant(rng: np.random.Generator, drop: float) -> list[Part]:
    """A hanging lamp whose cord starts at the origin and whose shade ends `drop` metres below."""
    j = Joinery(rng)
    wide, tall = float(rng.uniform(0.1, 0.25)), float(rng.uniform(0.12, 0.26))
    stuff = finishes.fitting(rng) if rng.uniform() < 0.5 else finishes.paint(rng)
    low, high, wall = -drop, tall - drop, 0.004
    j.add(finishes.plain((0.03, 0.03, 0.03)), stick([0, 0, high - 0.01], [0, 0, -0.01], 0.003, 5))
    j.add(stuff, turned_post([(0, -0.03), (0.05, -0.03), (0.05, 0.0), (0, 0.0)], 12))
    if rng.uniform() < 0.3:
        t = np.linspace(0, np.pi, 9)
        globe = np.stack([0.8 * wide * np.sin(t), low + 0.8 * wide * (1 - np.cos(t))], -1)
        globe[[0, -1], 0] = 0.0
        j.add(finishes.glow((0.95, 0.9, 0.8), float(rng.uniform(0.8, 1.6))), turned_post(globe, 16))
        return j.parts()
    neck = 0.03
    curve = float(rng.uniform(0.5, 2.0))
    t = np.linspace(0, 1, 6)
    outer = np.stack([wide + (neck - wide) * t**curve, low + tall * t], -1)
    inner = outer[::-1] - [wall, 0.0]
    j.add(
        stuff, turned_post(np.concatenate([inner[-1:], outer, [[0, high]], [[0, high - 0.006]], inner]), 20)
    )
    bulb = [(0, low + 0.02), (0.03, low + 0.045), (0.03, low + 0.07), (0.012, low + 0.11), (0, low + 0.11)]
    j.add(finishes.glow((0.95, 0.88, 0.7), float(rng.uniform(2.0, 5.0))), turned_post(bulb, 10))
    return j.parts()


def ceiling_lamp(rng: np.random.Generator) -> list[Part]:
    """A flat lamp below the origin."""
    j = Joinery(rng)
    wide = float(rng.uniform(0.12, 0.25))
    if rng.uniform() < 0.6:
        r, h = np.array([0, 0.8, 1.0, 1.0, 0]) * wide, np.array([-0.09, -0.085, -0.05, -0.015, -0.015])
        j.add(
            finishes.glow((0.95, 0.92, 0.85), float(rng.uniform(0.8, 2.0))),
            turned_post(np.stack([r, h], -1), 18),
        )
        j.add(finishes.fitting(rng), slab((wide + 0.01,) * 2, wide + 0.01, [[(0.0, -0.02), (0.0, 0.0)]], 4))
        return j.parts()
    metal, bulb = finishes.fitting(rng), finishes.glow((0.95, 0.9, 0.75), 4.0)
    j.board(metal, (-0.4, -0.03, -0.03), (0.4, 0.03, 0.0), 0.003)
    for x in (-0.3, 0.0, 0.3):
        j.add(
            metal,
            turned_post([(0, 0), (0.03, 0.0), (0.035, -0.09), (0.03, -0.09), (0.025, -0.02), (0, -0.02)], 10),
            (x, 0, -0.03),
        )
        j.add(bulb, turned_post([(0, -0.07), (0.028, -0.07), (0.028, -0.06), (0, -0.06)], 10), (x, 0, -0.03))
    return j.parts()


def radiator(rng: np.random.Generator, wide: float, high: float) -> list[Part]:
    """A panel radiator with ribs on a wall at y = 0, x from 0 to `wide`; it ends at `high`."""
    j = Joinery(rng)
    white = finishes.plain(np.full(3, rng.uniform(0.7, 0.85)), "metal", 0.4)
    j.board(white, (0.0, 0.03, 0.12), (wide, 0.075, high), 0.006)
    for x in np.arange(0.03, wide - 0.04, 0.06).tolist():
        j.board(white, (x, 0.075, 0.15), (x + 0.03, 0.082, high - 0.03))
    for x in (0.08, wide - 0.08):
        j.add(white, stick([x, 0.05, 0.0], [x, 0.05, 0.125], 0.008, 6))
    return j.parts()


def picture(rng: np.random.Generator, wide: float, high: float) -> list[Part]:
    """A framed picture on a wall at y = 0, centred at the origin."""
    j = Joinery(rng)
    frame, bar = finishes.fitting(rng) if rng.uniform() < 0.4 else finishes.carcass(rng, 0.4), 0.02
    x, z = wide / 2, high / 2
    art = (
        label(rng)
        if rng.uniform() < 0.6
        else material("paper", rng, str(rng.choice(["marble", "wallpaper", "cloth"])))
    )
    mount = 0.04 if rng.uniform() < 0.6 else 0.0
    if mount:
        j.board(
            finishes.plain((0.8, 0.79, 0.75), "paper", 0.8),
            (-x + bar, 0.002, -z + bar),
            (x - bar, 0.008, z - bar),
        )
    inner = bar + mount
    print_ = slab((x - inner, z - inner), 0.0, [[(0.0, 0.0), (0.0, 0.004)]], 0)
    uv = print_.vertices[:, :2] / [2 * (x - inner), 2 * (z - inner)] + 0.5
    sheet = Mesh(print_.vertices, print_.faces, uv.astype(np.float32))
    j.add(art, sheet, (0, 0.008, 0), np.pi, np.pi / 2)
    for s in (-x, x - bar):
        j.board(frame, (s, 0.0, -z), (s + bar, 0.025, z), 0.003)
    for s in (-z, z - bar):
        j.board(frame, (-x + bar, 0.0, s), (x - bar, 0.025, s + bar), 0.003)
    return j.parts()


RUG = 0.008
"""Thickness of a rug, metres."""


def rug(rng: np.random.Generator, half: tuple[float, float]) -> list[Part]:
    """A rug on the floor, centred; sometimes with a border."""
    j = Joinery(rng)
    radius = min(half) if abs(half[0] - half[1]) < 0.05 and rng.uniform() < 0.5 else 0.02
    border = rng.uniform() < 0.4 and radius < 0.1
    if border:
        j.add(finishes.fabric_own(rng), slab(half, radius, [[(0.0, 0.0), (0.0, RUG - 0.002)]], 3))
        half = (half[0] - 0.08, half[1] - 0.08)
    corner = 8 if radius > 0.1 else 3
    j.add(finishes.fabric_own(rng), slab(half, radius, [[(0.0, 0.0), (0.002, RUG)]], corner))
    return j.parts()
