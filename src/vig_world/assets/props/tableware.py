"""Props of the table: bowl, plate, mug, tumbler, jug, candle, shaker, egg cup."""

from __future__ import annotations

import numpy as np

from vig_world.assets.props.families import family
from vig_world.assets.props.material import Prop, bare, ceramic, material, metal, prop
from vig_world.assets.props.shapes import moved, revolve, smooth, superellipse, tube, vessel
from vig_world.assets.textures import colour, shade
from vig_world.mesh import Mesh


@family("cooking", "dining", "display", "storage")
def bowl(rng: np.random.Generator) -> Prop:
    """A bowl, round or slightly lobed, on a foot."""
    radius = rng.uniform(0.05, 0.13)
    height = radius * rng.uniform(0.45, 0.95)
    foot = radius * rng.uniform(0.35, 0.6)
    belly = rng.uniform(0.75, 1.02)
    wall = smooth(
        [[foot, 0], [foot, 0.06 * height], [belly * radius * 0.88, 0.45 * height], [radius, height]], 8
    )
    outline = 1 + rng.choice([0, 0, 0.03]) * np.cos(8 * 2 * np.pi * np.arange(32) / 32)
    return prop("bowl", (revolve(vessel(wall, 0.005, 0.008), 32, outline), ceramic(rng)))


@family("cooking", "dining", "display", "storage")
def plate(rng: np.random.Generator) -> Prop:
    """One to three stacked plates."""
    radius, height = rng.uniform(0.08, 0.14), rng.uniform(0.012, 0.028)
    foot = radius * rng.uniform(0.5, 0.65)
    wall = smooth(
        [[foot, 0], [foot * 1.05, 0.15 * height], [0.78 * radius, 0.5 * height], [radius, height]], 5
    )
    mesh = revolve(vessel(wall, 0.005, 0.004, 1), 28)
    count = int(rng.choice([1, 1, 2, 2]))
    glaze = ceramic(rng)
    parts = [(moved(mesh, (*rng.normal(0, 0.001, 2), 0.0065 * i)), glaze) for i in range(count)]
    return prop("plate", *parts)


def handle_of(radius: float, low: float, high: float, reach: float, thickness: float, dip: float) -> Mesh:
    """A handle on the +X side of a round wall, from `low` to `high`, sticking out by `reach`."""
    t = np.linspace(0, np.pi, 11)
    out = radius - 0.6 * thickness + (reach + 0.6 * thickness) * np.sin(t) ** 0.75
    up = (high + low) / 2 + (high - low) / 2 * np.cos(t) + dip * np.sin(t) * np.cos(t / 2)
    path = np.stack([out, 0 * t, up], 1)
    return tube(path, np.full((11, 2), [thickness, 1.4 * thickness]), 6, up=(0, 1, 0))


@family("cooking", "dining", "drinks", "desk", "reading", "storage", "bedside")
def mug(rng: np.random.Generator) -> Prop:
    """A mug with a handle; some have a saucer."""
    radius = rng.uniform(0.034, 0.048)
    height = rng.uniform(0.075, 0.115)
    bottom = radius * rng.uniform(0.7, 1.0)
    belly = radius * rng.uniform(0.95, 1.15)
    wall = smooth([[bottom * 0.94, 0], [bottom, 0.03 * height], [belly, 0.5 * height], [radius, height]], 8)
    glaze = ceramic(rng)
    body = revolve(vessel(wall, 0.004, 0.006), 26)
    reach = rng.uniform(0.02, 0.032)
    handle = handle_of(
        min(bottom, radius, belly), 0.25 * height, 0.78 * height, reach, rng.uniform(0.003, 0.005), 0.004
    )
    parts = [(body, glaze), (handle, bare(glaze if rng.uniform() < 0.8 else ceramic(rng)))]
    if rng.uniform() < 0.2:
        saucer = [[0.03, 0.0], [0.045, 0.004], [0.075, 0.015]]
        parts = [(moved(mesh, (0, 0, 0.007)), glaze) for mesh, _ in parts]
        parts.append((revolve(vessel(saucer, 0.004, 0.004, 1), 26), glaze))
    return prop("mug", *parts)


@family("cooking", "dining", "drinks", "display")
def jug(rng: np.random.Generator) -> Prop:
    """A milk or water jug: a bellied body, a lip pulled out on the -X side, a handle."""
    height = rng.uniform(0.1, 0.24)
    belly = height * rng.uniform(0.27, 0.42)
    neck, foot = belly * rng.uniform(0.55, 0.8), belly * rng.uniform(0.55, 0.85)
    rim = neck * rng.uniform(1.05, 1.3)
    wall = smooth([[foot, 0], [foot * 1.05, 0.03 * height], [belly, rng.uniform(0.3, 0.45) * height],
                   [neck, 0.8 * height], [rim, height]], 13)  # fmt: skip
    body = revolve(vessel(wall, 0.005, 0.008), 28)
    points = body.vertices.copy()
    angle = np.arctan2(points[:, 1], -points[:, 0])
    rise = np.clip((points[:, 2] - 0.8 * height) / (0.2 * height), 0, 1.1)
    lip = np.exp(-((angle / 0.45) ** 2)) * rise**2 * (np.hypot(points[:, 0], points[:, 1]) > 0.5 * neck)
    points[:, 0] -= (0.5 * rim * lip).astype(np.float32)
    points[:, 2] += (0.05 * height * lip).astype(np.float32)
    glaze = ceramic(rng)
    reach = rng.uniform(0.35, 0.55) * belly + 0.02
    handle = handle_of(
        neck, 0.38 * height, 0.86 * height, reach + belly - neck, rng.uniform(0.004, 0.007), 0.01
    )
    return prop("jug", (Mesh(points, body.faces, body.uv), glaze), (handle, bare(glaze)))


@family("dining", "drinks", "storage", "bedside", "washing")
def tumbler(rng: np.random.Generator) -> Prop:
    """An opaque drinking glass or beaker, straight, conical or squarish."""
    height = rng.uniform(0.07, 0.16)
    radius = rng.uniform(0.03, 0.043)
    bottom = radius * rng.uniform(0.65, 1.0)
    wall = np.linspace([bottom, 0.002], [radius, height], 4)
    wall = np.concatenate([[[bottom - 0.002, 0]], wall])
    outline = superellipse(32, rng.choice([2.0, 2.0, 4.0, 6.0]))
    kind = "glass" if rng.uniform() < 0.6 else "plastic"
    pattern = str(rng.choice(["paint", "paint", "wallpaper", "speckle"]))
    body = revolve(vessel(wall, 0.0025, 0.008), 32, outline)
    return prop("tumbler", (body, material(kind, rng, pattern)))


@family("dining", "reading", "display", "bedside", "washing")
def candle(rng: np.random.Generator) -> Prop:
    """A pillar candle, or a taper in a holder."""
    wax = material("wax", rng, "paint", shade([0.82, 0.77, 0.64], rng, 0.1) if rng.uniform() < 0.5 else None)
    black = material("cloth", rng, "paint", np.full(3, 0.03, np.float32), 16)
    taper = rng.uniform() < 0.5
    radius = 0.011 if taper else rng.uniform(0.025, 0.045)
    height = rng.uniform(0.12, 0.22) if taper else rng.uniform(0.05, 0.2)
    base = rng.uniform(0.02, 0.07) if taper else 0.0
    edge = 0.12 * radius
    pillar = np.array([
        [0, 0], [radius, 0], [radius, 0], [radius, height - edge], [radius - edge, height],
        [0.75 * radius, height], [0.3 * radius, height - 2 * edge], [0, height - 2 * edge],
    ])  # fmt: skip
    wick = np.linspace([0, 0, height - 3 * edge], [0.002, 0, height + 0.008], 3)
    lift = (0, 0, base)
    parts = [
        (moved(revolve(pillar, 24), lift), wax),
        (moved(tube(wick, 0.0009, 5, up=(0, 1, 0)), lift), black),
    ]
    if taper:
        foot = rng.uniform(0.035, 0.055)
        stem = np.array([
            [0, 0], [foot, 0], [foot, 0], [foot, 0.004], [0.5 * foot, 0.012], [0.008, 0.3 * base + 0.01],
            [0.010, 0.75 * base + 0.005], [0.017, base], [0.016, base + 0.012], [0, base + 0.012],
        ])  # fmt: skip
        parts.append((revolve(stem, 28), metal(rng) if rng.uniform() < 0.6 else ceramic(rng)))
    return prop("candle", *parts)


@family("cooking", "dining")
def shaker(rng: np.random.Generator) -> Prop:
    """A salt or pepper mill: turned wood, ceramic or plastic, with a cap of another material."""
    height = rng.uniform(0.07, 0.24)
    radius = rng.uniform(0.02, 0.032)
    waist = radius * rng.uniform(0.6, 1.0)
    side = smooth(
        [[radius, 0.004], [radius, 0.1 * height], [waist, 0.45 * height], [0.9 * radius, 0.75 * height]], 12
    )
    profile = np.concatenate([[[0, 0], [0.93 * radius, 0]], side, [side[-1], [0, 0.75 * height]]])
    head = smooth([[0.9, 0.75], [0.98, 0.84], [0.7, 0.96], [0.0, 1.0]], 9) * [radius, height]
    head[-1, 0] = 0.0
    cap = np.concatenate([[[0, 0.75 * height], head[0]], head])
    kinds = [material("wood", rng, "wood"), ceramic(rng), material("plastic", rng)]
    body = kinds[rng.integers(3)]
    return prop(
        "shaker",
        (revolve(profile, 28), body),
        (revolve(cap, 28), metal(rng) if rng.uniform() < 0.5 else body),
    )


@family("dining", "drinks")
def egg_cup(rng: np.random.Generator) -> Prop:
    """An egg in its cup."""
    height, rim = rng.uniform(0.045, 0.07), rng.uniform(0.022, 0.026)
    stem = rim * rng.uniform(0.35, 0.7)
    side = smooth([[rim, 0.0], [rim * 0.9, 0.08], [stem, 0.35], [rim * 0.9, 0.7], [rim, 1.0]], 14) * [
        1,
        height,
    ]
    cup = np.concatenate([[[0, 0]], side[:1], side, [[0.8 * rim, height], [0, height - 0.006]]])
    t = np.linspace(0, np.pi, 13)
    egg = np.stack([0.0215 * np.sin(t) * (1 + 0.12 * np.cos(t)), height + 0.012 - 0.029 * np.cos(t)], -1)
    egg[[0, -1], 0] = 0.0
    shell = shade([0.66, 0.44, 0.28] if rng.uniform() < 0.6 else [0.82, 0.79, 0.73], rng, 0.12)
    egg_shell = material("skin", rng, "speckle", shell)
    return prop("egg_cup", (revolve(cup, 28), ceramic(rng, colour(rng))), (revolve(egg, 24), egg_shell))
