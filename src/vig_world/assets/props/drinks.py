"""Props of the tea table and the bar: cup and saucer, goblet, sugar bowl, milk bottle, flask, ice bucket."""

from __future__ import annotations

import numpy as np

from vig_world.assets.props.families import family
from vig_world.assets.props.material import Prop, bare, ceramic, material, metal, plain, plastic, prop, steel
from vig_world.assets.props.shapes import box, moved, revolve, smooth, tube, vessel
from vig_world.assets.props.tableware import handle_of
from vig_world.assets.textures import near, shade


@family("dining", "drinks", "desk", "reading")
def cup_saucer(rng: np.random.Generator) -> Prop:
    """A tea or coffee cup on its saucer, with something in it."""
    radius, height = rng.uniform(0.034, 0.052), rng.uniform(0.045, 0.065)
    foot = radius * rng.uniform(0.45, 0.6)
    wall = smooth([[foot, 0], [foot, 0.06 * height], [0.85 * radius, 0.45 * height], [radius, height]], 8)
    glaze = ceramic(rng)
    lift = 0.006
    saucer = [[0.5 * radius, 0.0], [0.95 * radius, 0.003], [1.75 * radius, 0.014]]
    drink = [[0.055, 0.02, 0.007], [0.20, 0.07, 0.02], [0.42, 0.27, 0.15]][rng.integers(3)]
    level = 0.8 * height
    inside = float(np.interp(level, wall[:, 1], wall[:, 0])) - 0.003
    disc = revolve([[0, level - 0.004], [inside, level - 0.004], [inside, level], [0, level]], 20)
    parts = [
        (moved(revolve(vessel(wall, 0.003, 0.005), 26), (0, 0, lift)), glaze),
        (
            moved(handle_of(0.9 * radius, 0.3 * height, 0.8 * height, 0.022, 0.003, 0.003), (0, 0, lift)),
            bare(glaze),
        ),
        (revolve(vessel(saucer, 0.003, 0.003, 1), 28), glaze),
        (moved(disc, (0, 0, lift)), plain("glass", rng, shade(drink, rng))),
    ]
    if rng.uniform() < 0.4:  # a spoon on the saucer
        s = np.linspace(0, 1, 8)
        path = np.stack([0.11 * (s - 0.4), np.full(8, -1.2 * radius), np.full(8, 0.0155)], 1)
        width = np.where(s > 0.72, 0.011 * np.sqrt(np.clip(1 - ((s - 0.86) / 0.16) ** 2, 0.05, 1)), 0.0025)
        parts.append((tube(path, np.stack([width, np.full(8, 0.0012)], 1), 6), steel(rng)))
    return prop("cup_saucer", *parts)


@family("dining", "drinks", "display")
def goblet(rng: np.random.Generator) -> Prop:
    """An opaque goblet: pottery, pewter, brass or coloured glass, filled or not."""
    height, bowl = rng.uniform(0.11, 0.19), rng.uniform(0.028, 0.042)
    foot, stem, waist = bowl * rng.uniform(0.75, 1.0), rng.uniform(0.004, 0.009), rng.uniform(0.35, 0.5)
    rim = bowl * rng.uniform(0.75, 1.0)
    wall = np.concatenate([
        [[foot, 0], [foot, 0.003]],
        smooth([[0.4 * foot, 0.012], [stem, 0.05 * height + 0.012], [stem, waist * height],
                [0.75 * bowl, (waist + 0.1) * height], [bowl, (waist + 0.3) * height], [rim, height]], 15),
    ])  # fmt: skip
    inner = wall[wall[:, 1] > (waist + 0.06) * height][::-2] - [0.002, 0]
    profile = np.concatenate([[[0, 0], wall[0]], wall, inner, [[0, (waist + 0.07) * height]]])
    choice = rng.uniform()
    stuff = ceramic(rng) if choice < 0.4 else metal(rng) if choice < 0.7 else plain("glass", rng)
    return prop("goblet", (revolve(profile, 24), stuff))


@family("cooking", "dining", "drinks")
def sugar_bowl(rng: np.random.Generator) -> Prop:
    """A sugar bowl with two handles and a lid, or open with sugar lumps."""
    radius, height = rng.uniform(0.038, 0.052), rng.uniform(0.05, 0.075)
    foot, neck = 0.6 * radius, radius * rng.uniform(0.75, 0.95)
    wall = smooth([[foot, 0], [foot * 1.02, 0.05 * height], [radius, 0.5 * height], [neck, height]], 7)
    glaze = ceramic(rng)
    parts = [(revolve(vessel(wall, 0.003, 0.005), 26), glaze)]
    grip = handle_of(0.93 * radius, 0.3 * height, 0.75 * height, 0.016, 0.003, 0.002)
    if rng.uniform() < 0.6:
        parts += [(grip, bare(glaze)), (moved(grip, turn=np.pi), bare(glaze))]
    if rng.uniform() < 0.6:
        dome = rng.uniform(0.012, 0.025)
        lid = smooth(
            [[neck, 0], [0.8 * neck, 0.5 * dome], [0.006, dome], [0.009, dome + 0.008], [0, dome + 0.013]], 12
        )
        lid[-1, 0] = 0
        profile = np.concatenate([[[0, -0.001], lid[0]], lid])
        parts.append((moved(revolve(profile, 26), (0, 0, height + 0.001)), glaze))
    else:
        white = plain("paper", rng, [0.83, 0.82, 0.79] if rng.uniform() < 0.7 else [0.5, 0.28, 0.1])
        for _ in range(4):
            at = (*rng.uniform(-0.5, 0.5, 2) * neck, height - 0.012 + rng.uniform(0, 0.008))
            parts.append(
                (moved(box((0.015, 0.015, 0.012), 0.001), at, rng.uniform(0, 3), rng.normal(0, 0.3)), white)
            )
    return prop("sugar_bowl", *parts)


@family("cooking", "dining", "drinks")
def milk_bottle(rng: np.random.Generator) -> Prop:
    """A bottle of milk or juice, full, with a cap of foil or plastic."""
    height, radius = rng.uniform(0.16, 0.24), rng.uniform(0.03, 0.042)
    side = smooth(
        [
            [radius, 0.004],
            [radius, 0.3 * height],
            [radius, 0.58 * height],
            [0.5 * radius, 0.82 * height],
            [0.48 * radius, 0.95 * height],
        ],
        12,
    )
    profile = np.concatenate([[[0, 0], [0.94 * radius, 0]], side, [[0, 0.95 * height]]])
    fill = shade(
        np.array([[0.82, 0.81, 0.77], [0.82, 0.81, 0.77], [0.75, 0.38, 0.05], [0.36, 0.06, 0.05]])[
            rng.integers(4)
        ],
        rng,
        0.1,
    )
    top, edge = 0.93 * height, 0.54 * radius
    cap = [[0, top], [edge, top], [edge, top], [edge, height - 0.002], [edge - 0.002, height], [0, height]]
    lid = metal(rng) if rng.uniform() < 0.4 else plastic(rng)
    return prop("milk_bottle", (revolve(profile, 24), plain("glass", rng, fill)), (revolve(cap, 18), lid))


@family("drinks", "desk", "storage", "floor")
def flask(rng: np.random.Generator) -> Prop:
    """A vacuum flask or drinking bottle of metal, with a cup as its lid."""
    height, radius = rng.uniform(0.2, 0.28), rng.uniform(0.03, 0.04)
    shoulder = rng.uniform(0.72, 0.82) * height
    body = [
        [0, 0],
        [0.95 * radius, 0],
        [radius, 0.004],
        [radius, shoulder],
        [radius, shoulder],
        [0.8 * radius, shoulder + 0.012],
        [0.8 * radius, shoulder + 0.012],
        [0, shoulder + 0.012],
    ]
    wide = radius * rng.choice([0.75, 0.98])
    lid = [
        [0, shoulder + 0.01],
        [wide, shoulder + 0.01],
        [wide, shoulder + 0.01],
        [0.92 * wide, height - 0.003],
        [0.85 * wide, height],
        [0, height],
    ]
    paint = steel(rng) if rng.uniform() < 0.4 else plain("metal", rng)
    return prop(
        "flask",
        (revolve(body, 26), paint),
        (revolve(lid, 24), steel(rng) if rng.uniform() < 0.5 else plastic(rng)),
    )


@family("dining", "drinks", "reading", "display", "storage")
def teacups(rng: np.random.Generator) -> Prop:
    """Two to four handleless cups: stacked, or side by side."""
    radius, height = rng.uniform(0.032, 0.042), rng.uniform(0.045, 0.07)
    foot = radius * rng.uniform(0.5, 0.7)
    wall = smooth([[foot, 0], [foot, 0.08 * height], [0.85 * radius, 0.5 * height], [radius, height]], 6)
    cup = revolve(vessel(wall, 0.003, 0.005, 1), 20)
    count, stacked = int(rng.integers(2, 4)), rng.uniform() < 0.5
    glaze = ceramic(rng)
    parts = []
    for k in range(count):
        turn = 2.2 * k
        apart = 1.25 * radius if count > 1 else 0
        at = (0, 0, 0.32 * height * k) if stacked else (apart * np.cos(turn), apart * np.sin(turn), 0)
        parts.append((moved(cup, at, rng.uniform(0, 6)), glaze))
    return prop("teacups", *parts)


@family("cooking", "drinks", "storage")
def tea_packet(rng: np.random.Generator) -> Prop:
    """A caddy or paper bag of tea or coffee, its top folded down."""
    width, depth, height = rng.uniform([0.06, 0.045, 0.1], [0.1, 0.065, 0.18])
    paper = material(
        "paper", rng, "print", near([0.4, 0.27, 0.15], rng, 0.2) if rng.uniform() < 0.5 else None, 128
    )
    body = box((width, depth, height), 0.006)
    points = body.vertices.copy()
    points[:, 1] *= 1 - 0.7 * np.clip(points[:, 2] / height, 0, 1) ** 3
    fold = moved(box((width, 0.2 * depth + 0.006, 0.016), 0.002), (0, 0.003, height - 0.008))
    return prop("tea_packet", (type(body)(points, body.faces, body.uv), paper), (fold, paper))
