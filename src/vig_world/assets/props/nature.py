"""Props that grew: apple, orange, lemon, banana, pear, plants in vases and pots."""

from __future__ import annotations

import numpy as np

from vig_world.assets.props.families import family
from vig_world.assets.props.material import Material, Prop, ceramic, material, prop
from vig_world.assets.props.shapes import moved, revolve, scaled, smooth, tube, vessel
from vig_world.assets.textures import Array, near, noise, shade
from vig_world.mesh import Mesh


def _skin(rng: np.random.Generator, low: Array, high: Array, blush: float = 1.0) -> Material:
    """Fruit skin: two colours blended in soft patches."""
    patches = np.clip(0.5 + 0.5 * blush * noise(rng, 64, 1.8), 0, 1)[..., None]
    image = low + (high - low) * patches * (1 + 0.04 * noise(rng, 64, 0.4)[..., None])
    return Material(np.clip(image, 0.02, 0.95).astype(np.float32), "skin", float(rng.uniform(0.3, 0.6)))


def _stalk(rng: np.random.Generator, height: float, length: float) -> tuple[Mesh, Material]:
    path = smooth(
        [[0, 0, height - 0.01], [0.001, 0, height], [rng.uniform(0.002, 0.006), 0, height + length]], 5
    )
    brown = near([0.12, 0.07, 0.03], rng)
    return tube(path, [0.001, 0.001, 0.0011, 0.0013, 0.0018], 6, up=(0, 1, 0)), material(
        "wood", rng, "paint", brown, 8
    )


@family("cooking", "dining", "reading")
def apple(rng: np.random.Generator) -> Prop:
    """An apple."""
    radius = rng.uniform(0.03, 0.042)
    tall = rng.uniform(0.85, 1.02)
    profile = smooth([[0, 0.1], [0.3, 0.02], [0.75, 0.32], [1.0, 1.0], [0.8, 1.6], [0.4, 1.78], [0.12, 1.68],
                      [0, 1.58]], 16) * [radius, radius * tall]  # fmt: skip
    profile[[0, -1], 0] = 0.0
    colours = np.array([[0.45, 0.03, 0.03], [0.30, 0.45, 0.06], [0.65, 0.50, 0.10], [0.25, 0.02, 0.04]])
    pick = rng.integers(4, size=2)
    lobes = 1 + 0.015 * np.cos(5 * 2 * np.pi * np.arange(24) / 24)
    skin = _skin(rng, near(colours[pick[0]], rng), near(colours[pick[1]], rng))
    return prop("apple", (revolve(profile, 24, lobes), skin), _stalk(rng, 1.62 * radius * tall, 0.014))


@family("cooking", "dining")
def orange(rng: np.random.Generator) -> Prop:
    """An orange, mandarin or grapefruit."""
    radius, flat = rng.uniform(0.027, 0.05), rng.uniform(0.85, 1.0)
    t = np.linspace(0, np.pi, 13)
    profile = np.stack([radius * np.sin(t), radius * flat * (1 - np.cos(t))], -1)
    profile[[0, -1], 0] = 0.0
    base = shade([0.72, 0.25, 0.02], rng)
    return prop("orange", (revolve(profile, 24), _skin(rng, base, near(base, rng, 0.2), 0.5)))


@family("cooking", "drinks")
def lemon(rng: np.random.Generator) -> Prop:
    """A lemon or lime lying on its side."""
    radius = rng.uniform(0.022, 0.032)
    long = rng.uniform(1.25, 1.5)
    profile = smooth([[0, -1.25], [0.18, -1.18], [0.32, -1.02], [0.8, -0.6], [1.0, 0], [0.8, 0.6], [0.3, 1.0],
                      [0.14, 1.12], [0, 1.16]], 17) * [radius, radius * long]  # fmt: skip
    profile[[0, -1], 0] = 0.0
    base = near(np.array([[0.80, 0.60, 0.04], [0.25, 0.42, 0.05]])[rng.integers(2)], rng)
    mesh = moved(revolve(profile, 20), tilt=np.pi / 2 + rng.normal(0, 0.1), turn=rng.uniform(0, 2 * np.pi))
    return prop("lemon", (mesh, _skin(rng, base, near(base, rng, 0.2), 0.5)))


@family("cooking", "dining")
def pear(rng: np.random.Generator) -> Prop:
    """A pear."""
    radius = rng.uniform(0.03, 0.038)
    profile = smooth([[0, 0.08], [0.3, 0.0], [0.85, 0.4], [1.0, 0.95], [0.75, 1.65], [0.45, 2.2], [0.35, 2.6],
                      [0.15, 2.75], [0, 2.72]], 17) * radius  # fmt: skip
    profile[[0, -1], 0] = 0.0
    green, brown = shade([0.42, 0.45, 0.10], rng, 0.25), shade([0.42, 0.24, 0.09], rng)
    return prop(
        "pear", (revolve(profile, 22), _skin(rng, green, brown, 0.6)), _stalk(rng, 2.72 * radius, 0.02)
    )


@family("cooking", "dining")
def banana(rng: np.random.Generator) -> Prop:
    """One to four bananas in a bunch, lying."""
    length, bend = rng.uniform(0.15, 0.2), rng.uniform(0.7, 1.2)
    count = int(rng.integers(1, 5))
    ripe = near(
        np.array([[0.75, 0.55, 0.06], [0.45, 0.50, 0.08], [0.60, 0.38, 0.06]])[rng.integers(3)], rng, 0.1
    )
    spots = _skin(rng, ripe, near(ripe, rng, 0.3), 0.4)
    s = np.linspace(-0.5, 0.5, 18)
    arc = length / bend
    thickness = 0.017 * np.clip(1 - (2 * np.abs(s)) ** 8, 0.22, 1) * rng.uniform(0.9, 1.1)
    thickness[-3:] = 0.005
    thickness[0] = 0.003
    parts = []
    for i in range(count):
        fan = 0.16 * (i - (count - 1) / 2)
        x = arc * np.sin(bend * s)
        y = arc * (1 - np.cos(bend * s)) + 0.036 * (i - (count - 1) / 2) * (1 - 1.9 * (s > 0) * s)
        z = thickness + 0.012 * np.sin(np.pi * (s + 0.5)) * (i % 2)
        mesh = tube(smooth(np.stack([x, y, z], -1), 18), np.stack([thickness, thickness], -1), 7)
        parts.append((moved(mesh, (0, 0, 0), 0.2 * fan), spots))
    return prop("banana", *parts)


def _foliage(
    rng: np.random.Generator, base: float, spread: float, height: float
) -> list[tuple[Mesh, Material]]:
    """Curved leaves that spring from (0, 0, base), to about `spread` aside and `height` above."""
    green = near(
        np.array([[0.08, 0.22, 0.04], [0.15, 0.30, 0.06], [0.10, 0.20, 0.10]])[rng.integers(3)], rng, 0.3
    )
    count = int(rng.integers(8, 14))
    slim = rng.uniform(0.08, 0.17)
    leaves = [material("leaf", rng, "marble" if rng.uniform() < 0.2 else "paint", near(green, rng, 0.25), 32)
              for _ in range(3)]  # fmt: skip
    s = np.linspace(0, 1, 7)
    widths = np.stack([np.full(7, 0.008), np.maximum(np.sin(np.pi * s**1.6), 0.03)], -1)
    shapes = [  # leaves one unit wide and high, which droop more or less
        tube(
            smooth([[0, 0, 0], [0.25, 0, 0.5], [0.7, 0, 1], [1.15, 0, 1 - droop]], 7), widths, 4, up=(0, 1, 0)
        )
        for droop in rng.uniform(0.0, [0.1, 0.3, 0.5])
    ]
    parts = []
    for i in range(count):
        out = spread * np.sqrt((i + 1) / count) * rng.uniform(0.7, 1.1)
        rise = height * (1 - 0.5 * (i / count)) * rng.uniform(0.75, 1.0)
        leaf = scaled(shapes[3 * i // count], [out, slim * np.hypot(out, rise), rise])
        parts.append((moved(leaf, (0, 0, base), 2.4 * i + rng.normal(0, 0.25)), leaves[i % 3]))
    return parts


@family("dining", "display")
def vase_plant(rng: np.random.Generator) -> Prop:
    """A vase with leafy branches."""
    height = rng.uniform(0.09, 0.18)
    belly, neck = rng.uniform(0.03, 0.06), rng.uniform(0.014, 0.026)
    foot = belly * rng.uniform(0.5, 0.9)
    wall = smooth([[foot, 0], [foot * 1.02, 0.03 * height], [belly, rng.uniform(0.3, 0.6) * height],
                   [neck, 0.88 * height], [neck * 1.25, height]], 9)  # fmt: skip
    body = revolve(vessel(wall, 0.003, 0.006), 22)
    room = 0.3 - height
    parts = _foliage(rng, 0.85 * height, rng.uniform(0.04, 0.1), rng.uniform(0.5, 0.95) * room)
    return prop("vase_plant", (body, ceramic(rng)), *parts)


@family("desk", "reading", "display", "washing", "floor")
def pot_plant(rng: np.random.Generator) -> Prop:
    """A house plant in a flower pot."""
    height, radius = rng.uniform(0.06, 0.11), rng.uniform(0.035, 0.06)
    low = radius * rng.uniform(0.65, 0.85)
    wall = [[low / radius, 0], [0.95, 0.8], [0.95, 0.8], [1.03, 0.8], [1.03, 0.8], [1.05, 1]] * np.array(
        [radius, height]
    )
    clay = ceramic(rng, near([0.50, 0.20, 0.10], rng) if rng.uniform() < 0.4 else None)
    earth = material("earth", rng, "speckle", [0.06, 0.04, 0.025], 32)
    edge = 0.95 * radius - 0.003
    soil = [[0, 0.78 * height], [edge, 0.8 * height], [edge, 0.84 * height], [0, 0.9 * height]]
    parts = _foliage(rng, 0.85 * height, rng.uniform(0.04, 0.11), rng.uniform(0.06, 0.19))
    return prop(
        "pot_plant", (revolve(vessel(wall, 0.004, 0.01), 24), clay), (revolve(soil, 18), earth), *parts
    )
