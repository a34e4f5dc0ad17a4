"""Beds, floor lamps and large plants."""

from __future__ import annotations

import numpy as np

from vig_world.assets.furniture import finishes
from vig_world.assets.furniture.fronts import legs
from vig_world.assets.furniture.furniture import Furniture, family
from vig_world.assets.furniture.joinery import Joinery, cushion, rod, slab, stick, turned_post
from vig_world.assets.props.shapes import tube


@family
def bed(rng: np.random.Generator) -> Furniture:
    """A bed for one or two with its head at +Y: frame, mattress, cover and pillows."""
    j = Joinery(rng)
    double = rng.uniform() < 0.6
    x = float(rng.uniform(0.7, 0.85) if double else rng.uniform(0.45, 0.55))
    y, z = 1.02, float(rng.uniform(0.46, 0.58))
    wood = finishes.carcass(rng, 0.25)
    rail = float(rng.uniform(0.26, 0.32))
    for side in (-1, 1):
        a, b = sorted((side * x, side * (x + 0.025)))
        j.board(wood, (a, -y, rail - 0.14), (b, y, rail), 0.002)
    j.board(wood, (-x, -y, rail - 0.14), (x, -y + 0.025, rail), 0.002)
    j.board(wood, (-x, -y + 0.025, rail - 0.06), (x, y, rail - 0.04))
    legs(j, wood, (x - 0.03, y - 0.05), rail - 0.14, 0.06, str(rng.choice(["square", "round"])))
    head = float(rng.uniform(0.85, 1.15))
    if rng.uniform() < 0.5:
        pad = cushion((x + 0.03, (head - 0.2) / 2), 0.08, 0.05, 3)
        j.add(finishes.fabric(rng), pad, (0, y + 0.08, 0.2 + (head - 0.2) / 2), tilt=np.pi / 2)
    else:
        j.board(wood, (-x - 0.03, y, 0.0), (x + 0.03, y + 0.04, head), 0.004)
        j.board(wood, (-x - 0.04, y - 0.008, head - 0.04), (x + 0.04, y + 0.05, head + 0.01), 0.006)
    white = finishes.plain(np.full(3, rng.uniform(0.65, 0.85)) * [1, 0.99, 0.96], "cloth", 0.95)
    j.add(white, cushion((x - 0.01, y - 0.03), z - 0.05 - rail + 0.04, 0.05), (0, 0, rail - 0.04))
    fold = y - float(rng.uniform(0.5, 0.65))  # the cover ends before the pillows
    middle, half = (fold - y) / 2, (fold + y) / 2
    cover = cushion((x + 0.015, half), 0.22, 0.05, 4)
    j.add(finishes.fabric(rng), cover, (0, middle, z - 0.22))
    j.add(white, cushion((x + 0.018, 0.1), 0.2, 0.04, 3), (0, fold - 0.08, z - 0.192))
    reach = x - 0.06
    j.support("reading", (-reach, 0.1 - y), (reach, fold - 0.2), z)
    for px in (-x / 2, x / 2) if double else (0.0,):
        half_x = 0.88 * x / (2 if double else 1)
        pillow = cushion((min(half_x, 0.36), 0.21), 0.15, 0.07, 3)
        j.add(white, pillow, (px, y - 0.26, z - 0.06), float(rng.normal(0, 0.05)), 0.12)
    return j.done("bed")


@family
def floor_lamp(rng: np.random.Generator) -> Furniture:
    """A lamp on a stand or on three legs; its shade glows in most."""
    j = Joinery(rng)
    high, wide = float(rng.uniform(1.35, 1.65)), float(rng.uniform(0.15, 0.24))
    metal = finishes.fitting(rng)
    shade_low = high - float(rng.uniform(0.2, 0.32))
    if rng.uniform() < 0.35:
        stuff = finishes.wood(rng)
        for k in range(3):
            angle = 2 * np.pi * k / 3 + 0.5
            foot = [0.24 * np.cos(angle), 0.24 * np.sin(angle), 0.0]
            j.add(stuff, stick(foot, [0, 0, shade_low - 0.08], 0.013, 6))
        j.add(metal, stick([0, 0, shade_low - 0.1], [0, 0, high - 0.05], 0.008, 6))
    else:
        r = np.array([0, 0.14, 0.14, 0.11, 0.012, 0.011, 0.011, 0])
        h = np.array([0, 0, 0.018, 0.026, 0.035, 0.1, high - 0.05, high - 0.05])
        j.add(metal, turned_post(np.stack([r, h], -1), 14))
    narrow = wide * float(rng.uniform(0.6, 1.0))
    wall = 0.004
    profile = [
        (wide - wall, shade_low),
        (wide, shade_low),
        (narrow, high),
        (narrow - wall, high),
        (wide - wall, shade_low),
    ]
    warm = np.array([0.85, 0.74, 0.55]) * rng.uniform(0.8, 1.0)
    lit = rng.uniform() < 0.7
    j.add(finishes.glow(warm, float(rng.uniform(0.5, 1.2)) if lit else 0.0), turned_post(profile, 20))
    bulb = [
        (0.0, shade_low + 0.05),
        (0.03, shade_low + 0.08),
        (0.03, shade_low + 0.12),
        (0.0, shade_low + 0.15),
    ]
    j.add(finishes.glow((0.95, 0.85, 0.65), 3.0 if lit else 0.0), turned_post(bulb, 8))
    return j.done("floor_lamp")


@family
def potted_tree(rng: np.random.Generator) -> Furniture:
    """A large house plant in a tub."""
    j = Joinery(rng)
    radius, deep = float(rng.uniform(0.14, 0.2)), float(rng.uniform(0.25, 0.38))
    tub = finishes.paint(rng)
    j.add(
        tub,
        slab(
            (radius, radius),
            radius,
            [
                [(0.2 * radius, 0.0), (0.0, deep)],
                [(0.0, deep), (0.012, deep)],
                [(0.012, deep), (0.02, deep - 0.04)],
            ],
            4,
        ),
    )
    green = np.array([0.07, 0.2, 0.05]) * rng.uniform(0.6, 1.5, 3)
    leaf, trunk = finishes.plain(green, "leaf", 0.5), finishes.plain((0.2, 0.13, 0.08), "wood", 0.8)
    high = float(rng.uniform(1.0, 1.7))
    j.add(
        trunk,
        rod([[0, 0, deep - 0.05], [0.02, 0.01, 0.6 * high], [0.0, 0.0, 0.85 * high]], 0.016, 6, (1, 0, 0)),
    )
    long = float(rng.uniform(0.25, 0.42))
    path = long * np.array([[0.0, 0.0, 0.0], [0.0, 0.45, 0.12], [0.0, 1.0, -0.2]])
    width = np.array([[0.004, 0.003], [0.16 * long, 0.002], [0.006, 0.002]])
    blade = tube(path, width, 4)
    count = int(rng.integers(16, 30))
    for k in range(count):
        root = (0.0, 0.0, high * (0.45 + 0.4 * k / count))
        j.add(leaf, blade, root, 2.4 * k + float(rng.uniform(-0.3, 0.3)), float(rng.uniform(-0.1, 1.2)))
    return j.done("potted_tree")
