"""Other household objects: ball, table lamp, clock, speaker."""

from __future__ import annotations

import numpy as np

from vig_world.assets.props.families import family
from vig_world.assets.props.material import Prop, ceramic, material, metal, prop
from vig_world.assets.props.shapes import box, moved, revolve, smooth, tube, vessel
from vig_world.mesh import Mesh


@family("floor")
def ball(rng: np.random.Generator) -> Prop:
    """A toy ball."""
    radius = rng.uniform(0.02, 0.075)
    t = np.linspace(0, np.pi, 15)
    profile = np.stack([radius * np.sin(t), radius * (1 - np.cos(t))], -1)
    profile[[0, -1], 0] = 0.0
    pattern = str(rng.choice(["paint", "wallpaper", "checker", "speckle", "terrazzo"]))
    return prop(
        "ball",
        (moved(revolve(profile, 28), tilt=rng.uniform(0, 3)), material("plastic", rng, pattern, size=128)),
    )


@family("desk", "reading", "display", "bedside")
def lamp(rng: np.random.Generator) -> Prop:
    """A small bedside lamp, unlit: a foot, a stem and a shade."""
    height = rng.uniform(0.2, 0.298)
    low = height * rng.uniform(0.5, 0.62)
    foot, wide = rng.uniform(0.035, 0.06), rng.uniform(0.05, 0.085)
    narrow = wide * rng.uniform(0.55, 0.95)
    belly = rng.uniform(0.012, 0.05)
    stem = smooth([[foot, 0.0], [foot * 0.9, 0.012], [belly * 0.6, 0.05], [belly, 0.6 * low], [0.008, low],
                   [0.006, low + 0.03]], 14)  # fmt: skip
    profile = np.concatenate([[[0, 0], stem[0]], stem, [[0, stem[-1, 1]]]])
    shade = vessel(np.linspace([wide, low], [narrow, height], 3), 0.002, 0.6 * (height - low))
    fabric = material("cloth", rng, str(rng.choice(["cloth", "wallpaper", "paint"])))
    body = [ceramic(rng), metal(rng), material("wood", rng, "wood")][rng.integers(3)]
    return prop("lamp", (revolve(profile, 22), body), (revolve(shade, 28), fabric))


@family("desk", "display", "bedside")
def clock(rng: np.random.Generator) -> Prop:
    """A round alarm clock on two feet."""
    radius, depth = rng.uniform(0.035, 0.07), rng.uniform(0.025, 0.05)
    face = 0.86 * radius
    profile = np.array([
        [0, 0], [0.92 * radius, 0], [radius, 0.004], [radius, depth - 0.004], [0.94 * radius, depth],
        [face, depth], [face, depth], [face, depth - 0.003], [face, depth - 0.003], [0, depth - 0.003],
    ])  # fmt: skip

    def upright(mesh: Mesh) -> Mesh:
        return moved(mesh, (0, 0, radius + 0.006), tilt=np.pi / 2)

    body = metal(rng) if rng.uniform() < 0.4 else material("plastic", rng)
    white = material("paper", rng, "paint", np.full(3, rng.choice([0.85, 0.8, 0.05]), np.float32), 32)
    dial = revolve(
        [[0, depth - 0.0032], [face, depth - 0.0032], [face, depth - 0.002], [0, depth - 0.002]], 36
    )
    ink = np.full(3, 0.03 if white.texture.mean() > 0.4 else 0.85, np.float32)
    black = material("plastic", rng, "paint", ink, 8)
    parts = [(upright(revolve(profile, 36)), body), (upright(dial), white)]
    for hour in range(12):
        tick = moved(box((0.0018, 0.14 * face, 0.0008)), (0, 0.85 * face, depth - 0.002))
        parts.append((upright(moved(tick, turn=hour * np.pi / 6)), black))
    for reach, width in ((0.5, 0.003), (0.75, 0.002)):
        hand = moved(box((width, reach * face, 0.0008)), (0, 0.42 * reach * face, depth - 0.0018))
        parts.append((upright(moved(hand, turn=rng.uniform(0, 2 * np.pi))), black))
    for side in (-0.7, 0.7):
        leg = np.array([[side * radius, -depth / 2, 0], [0.72 * side * radius, -depth / 2, 0.5 * radius]])
        parts.append((tube(leg, [0.003, 0.005], 8, up=(0, 1, 0)), body))
    return prop("clock", *parts)


@family("desk", "display", "floor")
def speaker(rng: np.random.Generator) -> Prop:
    """A loudspeaker or radio: a box with one or two cones."""
    width, depth, height = rng.uniform([0.07, 0.06, 0.1], [0.15, 0.12, 0.25])
    height = max(height, 1.45 * width)
    case = material("wood", rng, "wood") if rng.uniform() < 0.5 else material("plastic", rng)
    dark = material("plastic", rng, "paint", np.full(3, 0.04, np.float32), 16)
    rim = metal(rng)
    parts = [(box((width, depth, height), 0.003), case)]
    for radius, place in ((0.36 * width, 0.32), (0.2 * width, 0.76)):
        ring = [
            [0.8 * radius, -0.001],
            [radius, -0.001],
            [radius, 0.003],
            [0.8 * radius, 0.003],
            [0.8 * radius, -0.001],
        ]
        cone = [[0, -0.001], [0.8 * radius, -0.001], [0.8 * radius, 0.002], [0.3 * radius, 0.0006],
                [0.2 * radius, 0.002], [0, 0.003]]  # fmt: skip
        for profile, finish in ((ring, rim), (cone, dark)):
            offset = (0, -depth / 2, place * height)
            parts.append((moved(revolve(profile, 24), offset, tilt=np.pi / 2), finish))
    return prop("speaker", *parts)
