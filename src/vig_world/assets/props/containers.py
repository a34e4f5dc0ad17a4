"""Props that hold food and drink: can, bottle, jar, pen pot, tissue box, basket-like tub."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from vig_world.assets.props.families import family
from vig_world.assets.props.material import (
    Material,
    Prop,
    ceramic,
    label,
    material,
    metal,
    plastic,
    prop,
    steel,
    timber,
)
from vig_world.assets.props.shapes import box, moved, revolve, smooth, superellipse, tube, vessel
from vig_world.assets.textures import colour, near
from vig_world.mesh import Mesh


def band_of(radius: float, low: float, high: float, outline: ArrayLike = 1.0, segments: int = 28) -> Mesh:
    """A label round a body of the given radius: a closed thin sleeve, half a millimetre proud."""
    inner, outer = radius - 0.001, radius + 0.0005
    loop = [
        [inner, low],
        [outer, low],
        [outer, low],
        [outer, high],
        [outer, high],
        [inner, high],
        [inner, low],
    ]
    return revolve(loop, segments, outline, upright=True)


@family("cooking", "drinks", "storage")
def can(rng: np.random.Generator) -> Prop:
    """A food or drinks can with a printed label."""
    radius = rng.uniform(0.026, 0.052)
    height = rng.uniform(0.05, 0.17)
    rim = 0.003
    neck = radius * (0.85 if rng.uniform() < 0.4 else 0.99)
    profile = np.array([
        [0, 0.002], [neck - rim, 0.002], [neck - 0.002, 0], [neck, 0.001], [neck, 0.003], [radius, 0.008],
        [radius, height - 0.008], [neck, height - 0.003], [neck, height], [neck, height],
        [neck - 0.0015, height], [neck - 0.0015, height], [neck - 0.002, height - rim],
        [neck - 0.002, height - rim], [0, height - rim],
    ])  # fmt: skip
    return prop(
        "can", (revolve(profile, 28), metal(rng)), (band_of(radius, 0.009, height - 0.009), label(rng))
    )


@family("cooking", "dining", "drinks", "storage", "washing")
def bottle(rng: np.random.Generator) -> Prop:
    """A bottle of wine, oil, soap or water, with a label and a cap."""
    height = rng.uniform(0.14, 0.3)
    radius = rng.uniform(0.024, 0.042)
    neck = rng.uniform(0.011, 0.015)
    shoulder = height * rng.uniform(0.5, 0.72)
    slope = height * rng.uniform(0.75, 0.85)
    side = smooth([[radius, 0.004], [radius, 0.5 * shoulder], [radius, shoulder], [neck * 1.1, slope],
                   [neck, 0.95 * height]], 15)  # fmt: skip
    profile = np.concatenate(
        [[[0, 0], [0.94 * radius, 0]], side, [[neck * 0.7, 0.95 * height], [0, 0.95 * height]]]
    )
    outline = superellipse(28, float(rng.choice([2.0, 2.0, 4.0])))
    glass = near(np.array([[0.05, 0.12, 0.06], [0.20, 0.10, 0.04], [0.55, 0.62, 0.60]])[rng.integers(3)], rng)
    body = material(
        "glass" if rng.uniform() < 0.6 else "plastic", rng, "paint", glass if rng.uniform() < 0.6 else None
    )
    lid, edge = 0.9 * height, neck * 1.2
    cap = [[0, lid], [edge, lid], [edge, lid], [edge, height - 0.002], [edge - 0.002, height], [0, height]]
    low = rng.uniform(0.1, 0.25) * shoulder
    return prop(
        "bottle",
        (revolve(profile, 28, outline), body),
        (band_of(radius * 1.01, low, rng.uniform(0.7, 0.92) * shoulder, outline), label(rng)),
        (revolve(cap, 18), metal(rng) if rng.uniform() < 0.4 else plastic(rng)),
    )


@family("cooking", "display", "storage", "washing")
def jar(rng: np.random.Generator) -> Prop:
    """A storage jar with a lid (knob, screw cap or cork) and perhaps a label."""
    height, radius = rng.uniform(0.07, 0.2), rng.uniform(0.03, 0.06)
    belly = radius * rng.uniform(1.0, 1.2)
    outline = superellipse(28, float(rng.choice([2.0, 2.0, 3.5])))
    side = smooth([[0.93, 0], [1, 0.05], [belly / radius, 0.45], [1, 0.8], [0.85, 0.86]], 10) * [
        radius,
        height,
    ]
    profile = np.concatenate([[[0, 0], side[0]], side, [[0, 0.86 * height]]])
    glazed = rng.uniform() < 0.5
    body = (
        ceramic(rng) if glazed else material("glass", rng, str(rng.choice(["paint", "speckle", "terrazzo"])))
    )
    edge, low = 0.9 * radius, 0.84 * height
    lid = [
        [0, low],
        [edge, low],
        [edge, low],
        [edge, 0.95 * height],
        [edge, 0.95 * height],
        [0.9 * edge, height],
    ]
    knob = 0.25 * radius
    if rng.uniform() < 0.5:
        turned = np.array(
            [[0.6, 0], [0.6, 0], [0.55, 0.4], [0.9, 0.7], [1, 1], [0.8, 1.5], [0.4, 1.75], [0, 1.8]]
        )
        lid += (knob * turned + [0, height]).tolist()
    else:
        lid += [[0, height]]
    top = (body, metal(rng), timber(rng, 32))[rng.integers(3)]
    parts = [(revolve(profile, 28, outline), body), (revolve(lid, 28, outline), top)]
    if not glazed and rng.uniform() < 0.6:
        parts.append((band_of(1.005 * belly, 0.3 * height, 0.62 * height, outline), label(rng)))
    return prop("jar", *parts)


@family("desk")
def pen_pot(rng: np.random.Generator) -> Prop:
    """A pot of pens, brushes or wooden spoons."""
    height, radius = rng.uniform(0.08, 0.13), rng.uniform(0.032, 0.048)
    wall = np.linspace([radius * rng.uniform(0.8, 1.0), 0], [radius, height], 6)
    pot = revolve(vessel(wall, 0.003, 0.005), 28, superellipse(28, float(rng.choice([2.0, 2.0, 6.0]))))
    parts = [(pot, ceramic(rng))]
    for _ in range(rng.integers(3, 8)):
        angle, lean = rng.uniform(0, 2 * np.pi), rng.uniform(0.4, 0.85) * radius
        length = rng.uniform(0.14, 0.2)
        foot = np.array([-0.4 * lean * np.cos(angle), -0.4 * lean * np.sin(angle), 0.006])
        top = np.array([lean * np.cos(angle), lean * np.sin(angle), height])
        way = (top - foot) / np.linalg.norm(top - foot)
        across = (-np.sin(angle), np.cos(angle), 0.0)
        path = foot + length * np.array([0, 0.76, 0.82, 0.9, 0.97, 1.0])[:, None] * way
        style = rng.integers(3)
        thickness = rng.uniform(0.0028, 0.004)
        if style == 0:  # pen: ends in a point
            widths = np.outer([1, 1, 1, 1, 0.6, 0.2], [thickness, thickness])
        elif style == 1:  # spoon: ends in a blade
            widths = (
                np.array([[0.7, 0.7], [0.8, 0.6], [2.8, 0.5], [3.8, 0.4], [3.0, 0.4], [1.2, 0.4]]) * thickness
            )
        else:  # brush: ends in a tuft
            widths = np.outer([0.6, 0.8, 1.2, 1.7, 1.3, 0.4], [thickness, thickness])
        wooden = style > 0 and rng.uniform() < 0.7
        paint = timber(rng, 32) if wooden else plastic(rng)
        parts.append((tube(path, widths, 8, up=across), paint))
    return prop("pen_pot", *parts)


@family("dining")
def cutlery(rng: np.random.Generator) -> Prop:
    """One to three spoons or knives lying side by side."""
    shiny = steel(rng)
    parts = []
    for i in range(rng.integers(1, 4)):
        length = rng.uniform(0.15, 0.22)
        s = np.sin(np.linspace(0, np.pi / 2, 20))  # closer together towards the tip
        if rng.uniform() < 0.5:  # spoon
            bowl = np.sqrt(np.maximum(1 - ((s - 0.86) / 0.15) ** 2, 0))
            width = np.maximum(0.003 + 0.003 * np.exp(-((s / 0.3) ** 2)) * (s < 0.8), 0.02 * bowl)
            lift = 0.004 + 0.006 * np.sin(np.pi * s) - 0.003 * bowl
        else:  # knife
            width = np.where(s > 0.45, 0.009 * np.clip((1.03 - s) / 0.25, 0, 1) ** 0.5, 0.006)
            lift = np.full_like(s, 0.003)
        width[-1] = min(width[-1], 0.004)
        path = np.stack([0.028 * i + 0.001 * np.sin(3 * s), length * s, np.maximum(lift, 0.0025)], -1)
        parts.append((tube(path, np.stack([width, np.full_like(s, 0.0013)], -1), 6), shiny))
    return prop("cutlery", *parts)


@family("desk", "reading", "bedside", "washing")
def tissue_box(rng: np.random.Generator) -> Prop:
    """A box of tissues with one pulled out."""
    size = rng.uniform([0.1, 0.1, 0.06], [0.22, 0.13, 0.13])
    pattern = str(rng.choice(["wallpaper", "print", "checker", "paint", "terrazzo"]))
    s = np.linspace(0, 1, 9)
    sway = rng.uniform(-0.02, 0.02)
    path = np.stack([sway * s**2, 0.012 * np.sin(4 * s), size[2] - 0.004 + rng.uniform(0.03, 0.07) * s], -1)
    widths = np.stack([0.02 + 0.022 * np.sin(2.6 * s), 0.006 * (1.1 - s)], -1)
    tissue = tube(path, widths, 10, up=(0, 1, 0))
    white = material("cloth", rng, "paint", np.full(3, 0.85, np.float32), 32)
    hole = material("plastic", rng, "paint", np.full(3, 0.5, np.float32), 16)
    slot = revolve(np.array([[0, 0], [0.04, 0], [0.04, 0.0005], [0, 0.0005]]), 24)
    return prop(
        "tissue_box",
        (box(size, 0.0015), material("paper", rng, pattern, size=128)),
        (moved(slot, (0, 0, size[2])), hole),
        (tissue, white),
    )


@family("cooking", "drinks", "storage")
def tin(rng: np.random.Generator) -> Prop:
    """A tea or biscuit tin: square, oval or round, with a lid that overlaps."""
    height, radius = rng.uniform(0.05, 0.18), rng.uniform(0.04, 0.075)
    outline = superellipse(40, float(rng.choice([2.0, 5.0, 9.0])), rng.uniform(0.8, 1.2))
    lid = height * rng.uniform(0.7, 0.88)
    body = np.array([[0, 0], [radius, 0], [radius, 0], [radius, lid], [radius, lid], [0, lid]])
    edge = radius + 0.0015
    cap = [[0, lid - 0.002], [edge, lid - 0.002], [edge, lid - 0.002], [edge, height - 0.004],
           [edge - 0.003, height], [edge - 0.008, height], [0, height]]  # fmt: skip
    shell: Material = material("metal", rng, str(rng.choice(["print", "wallpaper", "paint"])), size=128)
    top = shell if rng.uniform() < 0.4 else material("metal", rng, "paint", colour(rng), 32)
    return prop("tin", (revolve(body, 40, outline, upright=True), shell), (revolve(cap, 40, outline), top))
