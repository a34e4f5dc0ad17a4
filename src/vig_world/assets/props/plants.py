"""Small plants: cut flowers in a vase, cacti and succulents in a pot."""

from __future__ import annotations

import numpy as np

from vig_world.assets.props.families import family
from vig_world.assets.props.material import Material, Prop, ceramic, material, plain, prop
from vig_world.assets.props.shapes import (
    blob,
    extrude,
    moved,
    revolve,
    scaled,
    smooth,
    superellipse,
    tube,
    vessel,
)
from vig_world.assets.textures import near, shade
from vig_world.mesh import Mesh


def _flower(daisies: bool) -> tuple[Mesh, Mesh]:
    """Petals and heart of a flower about one unit in radius, the stem's end at the origin."""
    if daisies:
        t = 2 * np.pi * np.arange(16) / 16
        star = np.stack([np.cos(t), np.sin(t)], 1) * (1 - 0.3 * (np.arange(16) % 2))[:, None]
        return extrude(star, 0.09), blob((0.6, 0.6, 0.35), 7, 4)
    head = smooth([[0, -0.3], [0.4, -0.25], [0.65, 0.35], [0.5, 0.8], [0.25, 0.7], [0, 0.5]], 8)
    head[[0, -1], 0] = 0.0
    lobes = 1 + 0.12 * np.cos(5 * 2 * np.pi * np.arange(10) / 10)
    return revolve(head, 10, lobes), blob((0.3, 0.3, 0.6), 6, 4)


@family("dining", "reading", "display", "bedside")
def vase_flowers(rng: np.random.Generator) -> Prop:
    """A vase or jug of cut flowers."""
    height, belly = rng.uniform(0.08, 0.15), rng.uniform(0.028, 0.045)
    neck = belly * rng.uniform(0.5, 0.9)
    wall = smooth(
        [
            [0.7 * belly, 0],
            [0.72 * belly, 0.03 * height],
            [belly, 0.4 * height],
            [neck, 0.85 * height],
            [1.15 * neck, height],
        ],
        7,
    )
    parts = [(revolve(vessel(wall, 0.003, 0.005, 1), 18), ceramic(rng))]
    green = plain("leaf", rng, near([0.11, 0.20, 0.06], rng, 0.25))
    tones = [
        [0.62, 0.05, 0.04],
        [0.75, 0.55, 0.06],
        [0.78, 0.76, 0.70],
        [0.60, 0.28, 0.34],
        [0.32, 0.20, 0.42],
        [0.70, 0.25, 0.05],
    ]
    tint = tones[rng.integers(6)]
    petals = [plain("leaf", rng, near(tint, rng, 0.25)) for _ in range(2)]
    heart = plain("leaf", rng, near([0.5, 0.34, 0.05], rng))
    daisies = bool(rng.integers(2))
    petal, middle = _flower(daisies)
    tall = rng.uniform(0.06, 0.13)
    for k in range(int(rng.integers(4, 7))):
        turn, lean = 2.4 * k + rng.uniform(0, 0.5), rng.uniform(0.01, 0.06) if k else 0.0
        way = np.array([np.cos(turn), np.sin(turn), 0.0])
        tip = lean * way + [0, 0, min(height + tall * rng.uniform(0.75, 1.1), 0.285)]
        stem = smooth([0.2 * neck * way + [0, 0, 0.4 * height], 0.5 * neck * way + [0, 0, height], tip], 5)
        parts.append((tube(stem, 0.0016, 4, up=(-np.sin(turn), np.cos(turn), 0.02)), green))
        side, tilt = rng.uniform(0.018, 0.028), rng.uniform(-0.5, 0.9 if daisies else 0.1)
        for mesh, stuff in ((petal, petals[k % 2]), (middle, heart))[: 1 + daisies]:
            parts.append((moved(scaled(mesh, side), tip, turn - np.pi / 2, tilt), stuff))
        if k % 2:
            leaf = smooth([stem[2], stem[3] + 0.02 * way, stem[3] + 0.04 * way - [0, 0, 0.004]], 5)
            widths = np.stack([np.full(5, 0.0006), [0.001, 0.006, 0.008, 0.005, 0.0008]], 1)
            parts.append((tube(leaf, widths, 4, up=(-np.sin(turn), np.cos(turn), 0.02)), green))
    return prop("vase_flowers", *parts)


@family("desk", "display", "washing")
def succulent(rng: np.random.Generator) -> Prop:
    """A cactus or a rosette in a small pot."""
    radius, height = rng.uniform(0.026, 0.042), rng.uniform(0.035, 0.055)
    wall = np.array([[0.75 * radius, 0], [0.95 * radius, 0.8 * height], [radius, height]])
    pot = ceramic(rng, shade([0.45, 0.17, 0.09], rng) if rng.uniform() < 0.4 else None)
    parts = [
        (
            revolve(vessel(wall, 0.003, 0.008, 1), 22, superellipse(22, float(rng.choice([2.0, 2.0, 6.0])))),
            pot,
        )
    ]
    soil = [
        [0, 0.7 * height],
        [0.88 * radius, 0.7 * height],
        [0.88 * radius, 0.86 * height],
        [0, 0.9 * height],
    ]
    parts.append((revolve(soil, 14), material("earth", rng, "speckle", [0.07, 0.05, 0.03], 16)))
    green = shade(
        np.array([[0.14, 0.24, 0.10], [0.22, 0.32, 0.22], [0.10, 0.20, 0.08]])[rng.integers(3)], rng
    )
    if rng.uniform() < 0.5:  # a cactus with ribs
        tall, wide = rng.uniform(0.04, 0.11), radius * rng.uniform(0.5, 0.8)
        side = smooth([[0.8, 0], [1.0, 0.4], [0.95, 0.75], [0.55, 0.97], [0, 1.0]], 11) * [wide, tall]
        side[-1, 0] = 0
        ribs = 1 + 0.09 * np.cos(8 * 2 * np.pi * np.arange(32) / 32)
        body = revolve(np.concatenate([[[0, 0], side[0]], side]), 32, ribs)
        skin = Material(
            (green * (1 + 0.2 * np.cos(np.arange(32) / 32 * 8 * np.pi))[None, :, None] * np.ones((8, 1, 1)))
            .clip(0.02, 0.95)
            .astype(np.float32),
            "leaf",
            0.6,
        )
        parts.append((moved(body, (0, 0, 0.85 * height)), skin))
    else:
        leaves = [material("leaf", rng, "paint", near(green, rng, 0.25), 16) for _ in range(2)]
        path = smooth([[0, 0, 0], [0.6, 0, 0.5], [1, 0, 1]], 5)
        widths = np.array([[0.09, 0.003], [0.12, 0.008], [0.12, 0.01], [0.09, 0.007], [0.015, 0.0008]])
        leaf = tube(path, widths, 6, up=(0, 1, 0))  # one unit long and high
        for k in range(17):
            out, rise = (0.35 + 0.75 * (k / 17)) * radius * 1.25, 0.03 * (1 - k / 17) + 0.006
            grown = scaled(leaf, [out, 1, rise])
            parts.append((moved(grown, (0, 0, 0.88 * height), 2.4 * k), leaves[k % 2]))
    return prop("succulent", *parts)
