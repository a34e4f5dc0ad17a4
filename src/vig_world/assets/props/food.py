"""Props to eat: bread, croissant, cheese, cake, grapes, tomato, carrot, onion, pepper."""

from __future__ import annotations

import numpy as np

from vig_world.assets.props.families import family
from vig_world.assets.props.material import Material, Prop, ceramic, material, plain, prop, steel, timber
from vig_world.assets.props.shapes import blob, box, extrude, moved, revolve, smooth, tube, vessel
from vig_world.assets.textures import near, noise, shade, texture
from vig_world.assets.textures.fields import mix
from vig_world.mesh import Mesh


def _baked(rng: np.random.Generator) -> Material:
    """Crust: pale and dark brown in patches, some flour."""
    low, high = shade([0.36, 0.17, 0.055], rng), shade([0.56, 0.32, 0.12], rng)
    image = mix(low, high, np.clip(0.5 + 0.35 * noise(rng, 64, 1.1), 0, 1))
    flour = np.clip(noise(rng, 64, 0.9) - rng.uniform(0.3, 2.5), 0, 0.6)
    image = mix(image, np.array([0.78, 0.72, 0.62], np.float32), flour)
    return Material(image.clip(0.02, 0.95).astype(np.float32), "skin", float(rng.uniform(0.6, 0.9)))


@family("cooking", "dining")
def bread(rng: np.random.Generator) -> Prop:
    """A loaf: round, long or from a tin; perhaps with its end cut and a slice beside it."""
    crust = _baked(rng)
    style = rng.integers(3)
    if style == 0:  # round
        size = rng.uniform(0.14, 0.2)
        loaf = blob((size, size * rng.uniform(0.85, 1), size * rng.uniform(0.45, 0.6)), 22, 10, 2.3)
        return prop("bread", (loaf, crust))
    if style == 1:  # long, with slashes
        length, width = rng.uniform(0.22, 0.3), rng.uniform(0.06, 0.085)
        s = np.linspace(-1, 1, 18)
        girth = width / 2 * np.clip(1 - np.abs(s) ** 5, 0.12, 1) * (1 + 0.05 * np.sin(22 * s))
        path = np.stack([length / 2 * s, 0.006 * s**2, 0.8 * girth], 1)
        return prop("bread", (tube(path, np.stack([girth, 0.8 * girth], 1), 14), crust))
    width, height, length = rng.uniform(0.09, 0.11), rng.uniform(0.09, 0.12), rng.uniform(0.14, 0.22)
    t = np.linspace(0, np.pi, 9)
    dome = np.stack([0.56 * width * np.cos(t), 0.62 * height + 0.38 * height * np.sin(t)], 1)
    outline = np.concatenate(
        [
            [
                [-0.45 * width, 0],
                [-0.45 * width, 0],
                [0.45 * width, 0],
                [0.45 * width, 0],
                [0.46 * width, 0.5 * height],
            ],
            dome,
            [[-0.46 * width, 0.5 * height]],
        ]
    )
    crumb = material("skin", rng, "speckle", shade([0.72, 0.58, 0.38], rng, 0.1), 32)
    parts = [(moved(extrude(outline, length, 0.008), (0, length / 2, 0), 0, np.pi / 2), crust)]
    if rng.uniform() < 0.6:
        cut = extrude(outline * 0.97, 0.004)
        parts.append((moved(cut, (0, -length / 2 + 0.001, 0.0015), 0, np.pi / 2), crumb))
        lying = moved(
            extrude(outline - [0, height / 2], 0.013, 0.002), (0, -length / 2 - 0.062, 0), rng.normal(0, 0.3)
        )
        parts.append((lying, crumb))
    return prop("bread", *parts)


@family("dining", "drinks")
def croissant(rng: np.random.Generator) -> Prop:
    """A croissant: a bent, ribbed roll; one or two."""
    parts = []
    for k in range(rng.integers(1, 3)):
        s = np.linspace(-1, 1, 27)
        bend, radius = rng.uniform(0.9, 1.4), rng.uniform(0.04, 0.05)
        girth = 0.026 * np.clip(1 - np.abs(s) ** 2.2, 0.1, 1) * (1 + 0.14 * np.abs(np.sin(3.5 * np.pi * s)))
        path = np.stack([radius * np.sin(bend * s) * 1.3, -radius * np.cos(bend * s), 0.85 * girth], 1)
        roll = tube(path, np.stack([girth, 0.85 * girth], 1), 10)
        parts.append((moved(roll, (0, 0.085 * k, 0), rng.normal(0, 0.3)), _baked(rng)))
    return prop("croissant", *parts)


@family("cooking", "dining")
def cheese(rng: np.random.Generator) -> Prop:
    """A wedge of cheese with its rind, on a board."""
    radius, height, angle = rng.uniform(0.08, 0.12), rng.uniform(0.03, 0.06), rng.uniform(0.5, 1.1)
    t = np.linspace(-angle / 2, angle / 2, 8)
    arc = radius * np.stack([np.cos(t), np.sin(t)], 1)
    outline = np.concatenate([[[0.0, 0.0], [0.0, 0.0]], arc[:1], arc, arc[-1:]])
    tone = shade(np.array([[0.72, 0.50, 0.14], [0.78, 0.68, 0.42], [0.75, 0.32, 0.06]])[rng.integers(3)], rng)
    inside = material("skin", rng, "speckle" if rng.uniform() < 0.5 else "paint", tone, 32)
    shell = plain("wax", rng, [[0.45, 0.03, 0.02], [0.42, 0.28, 0.12], [0.7, 0.66, 0.58]][rng.integers(3)])
    turn = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    oval = np.stack([0.6 * radius + 0.09 * np.cos(turn), 0.075 * np.sin(turn)], 1)
    parts = [(moved(extrude(outline, height, 0.001), (0, 0, 0.012)), inside)]
    parts.append((extrude(oval, 0.012, 0.002), timber(rng)))
    path = np.column_stack([arc, np.full(len(arc), 0.012 + height / 2)])
    square = np.array([[0.002, 0.72 * height]])  # half diagonals: the tube's four corners
    parts.append((tube(path, np.repeat(square, len(arc), 0), 4), shell))
    return prop("cheese", *parts)


@family("dining", "drinks")
def cake(rng: np.random.Generator) -> Prop:
    """A cake on a stand or plate, some of it perhaps eaten."""
    radius, height, foot = (
        rng.uniform(0.075, 0.1),
        rng.uniform(0.05, 0.08),
        rng.choice([0.006, rng.uniform(0.06, 0.1)]),
    )
    glaze = ceramic(rng, shade([0.78, 0.77, 0.73], rng, 0.1))
    plate = radius + 0.025
    if foot > 0.01:
        stand = [
            [0, 0],
            [0.6 * radius, 0],
            [0.55 * radius, 0.008],
            [0.016, 0.025],
            [0.014, 0.6 * foot],
            [0.04, foot - 0.006],
            [plate, foot - 0.002],
            [plate, foot + 0.004],
            [0.97 * plate, foot + 0.004],
            [0, foot],
        ]
    else:
        stand = [[0, 0], [0.7 * plate, 0], [plate, 0.01], [plate, 0.013], [0.7 * plate, foot], [0, foot]]
    dough = shade(
        np.array([[0.10, 0.045, 0.02], [0.62, 0.40, 0.17], [0.75, 0.70, 0.60], [0.62, 0.34, 0.32]])[
            rng.integers(4)
        ],
        rng,
    )
    cut = rng.uniform(0.3, 1.2) if rng.uniform() < 0.5 else 0.0
    t = np.linspace(cut / 2, 2 * np.pi - cut / 2, 26, endpoint=bool(cut))
    arc = radius * np.stack([np.cos(t), np.sin(t)], 1)
    outline = np.concatenate([[[0.0, 0.0]] * 2, arc[:1], arc, arc[-1:]]) if cut else arc
    body = extrude(outline, height, 0.0 if cut else 0.005)
    layers = np.tile(dough, (16, 4, 1)) * (1 + 0.05 * rng.standard_normal((16, 4, 1)))
    cream = shade([0.82, 0.76, 0.66], rng, 0.1)
    layers[[5, 10]] = cream
    parts = [
        (revolve(stand, 28), glaze),
        (moved(body, (0, 0, foot)), Material(layers.clip(0.02, 0.95).astype(np.float32), "skin", 0.8)),
    ]
    lid = moved(extrude(outline * 1.005, 0.004), (0, 0, foot + height - 0.001))
    parts.append((lid, plain("skin", rng, dough if rng.uniform() < 0.4 else cream)))
    berry = plain("skin", rng, near([0.4, 0.02, 0.03], rng))
    if rng.uniform() < 0.6:
        for a in np.arange(cut / 2 + 0.3, 2 * np.pi - cut / 2 - 0.1, 0.7):
            at = (0.78 * radius * np.cos(a), 0.78 * radius * np.sin(a), foot + height)
            parts.append((moved(blob((0.02, 0.02, 0.02), 8, 5), at), berry))
    return prop("cake", *parts)


@family("cooking", "dining")
def grapes(rng: np.random.Generator) -> Prop:
    """A bunch of grapes, lying."""
    tone = shade(np.array([[0.10, 0.02, 0.05], [0.38, 0.45, 0.12], [0.22, 0.04, 0.05]])[rng.integers(3)], rng)
    skins = [plain("skin", rng, near(tone, rng, 0.3)) for _ in range(3)]
    berry = blob((0.019, 0.019, 0.021), 7, 5)
    parts = []
    for layer, (count, z) in enumerate(((15, 0.0), (9, 0.015), (3, 0.029))):
        for k in range(count):
            along = (k + 0.5) / count
            x = (0.11 - 0.025 * layer) * (along - 0.5)
            wide = (0.032 - 0.009 * layer) * (1.1 - along)
            at = (x + rng.normal(0, 0.002), wide * ((k % 3) - 1) + rng.normal(0, 0.002), z)
            parts.append((moved(berry, at), skins[k % 3]))
    stalk = smooth([[-0.04, 0, 0.03], [-0.06, 0.004, 0.034], [-0.08, 0.01, 0.026]], 5)
    parts.append((tube(stalk, 0.002, 5), plain("wood", rng, [0.2, 0.14, 0.06])))
    return prop("grapes", *parts)


def _lobed(radius: float, height: float, lobes: int, depth: float, segments: int = 22) -> Mesh:
    profile = smooth(
        [[0, 0.05], [0.35, 0.0], [0.8, 0.22], [1.0, 0.6], [0.8, 0.92], [0.4, 0.98], [0.12, 0.9], [0, 0.86]],
        14,
    )
    profile[[0, -1], 0] = 0.0
    outline = 1 + depth * np.cos(lobes * 2 * np.pi * np.arange(segments) / segments)
    return revolve(profile * [radius, height], segments, outline)


@family("cooking")
def tomato(rng: np.random.Generator) -> Prop:
    """One to three tomatoes."""
    red = shade(np.array([[0.52, 0.04, 0.02], [0.6, 0.16, 0.02]])[rng.choice(2, p=[0.8, 0.2])], rng)
    skin, green = material("skin", rng, "paint", red, 32), plain("leaf", rng, near([0.10, 0.20, 0.04], rng))
    parts = []
    for k in range(rng.integers(1, 4)):
        radius = rng.uniform(0.026, 0.036)
        at = np.array([0.062 * (k % 2), 0.062 * (k // 2), 0])
        height = 1.55 * radius
        parts.append((moved(_lobed(radius, height, 5, 0.02, 14), at, rng.uniform(0, 6)), skin))
        for turn in 2 * np.pi * np.arange(5) / 5 + rng.uniform(0, 1):
            leaf = smooth(
                [[0, 0, 0.88 * height], [0.3 * radius, 0, 0.97 * height], [0.6 * radius, 0, 1.0 * height]], 4
            )
            widths = np.stack([np.full(4, 0.0008), [0.001, 0.003, 0.0025, 0.0005]], 1)
            parts.append((moved(tube(leaf, widths, 4, up=(0, 1, 0)), at, turn), green))
    return prop("tomato", *parts)


@family("cooking")
def pepper(rng: np.random.Generator) -> Prop:
    """A sweet pepper or an onion, standing."""
    green = plain("wood", rng, near([0.14, 0.22, 0.05], rng))
    if rng.uniform() < 0.6:
        tone = shade([[0.5, 0.03, 0.02], [0.72, 0.45, 0.03], [0.10, 0.24, 0.04]][rng.integers(3)], rng)
        radius, height = rng.uniform(0.032, 0.04), rng.uniform(0.075, 0.095)
        body, skin = (
            _lobed(radius, height, int(rng.integers(3, 5)), 0.12),
            material("skin", rng, "paint", tone, 32),
        )
        stalk = [[0, 0, 0.84 * height], [0.002, 0, height], [0.008, 0, 1.15 * height]]
    else:
        tone = shade([[0.50, 0.26, 0.09], [0.28, 0.06, 0.10], [0.74, 0.70, 0.62]][rng.integers(3)], rng)
        radius = rng.uniform(0.03, 0.042)
        profile = (
            smooth([[0, 0.0], [0.3, 0.02], [1, 0.85], [0.5, 1.6], [0.12, 1.85], [0.08, 2.2], [0, 2.25]], 15)
            * radius
        )
        profile[[0, -1], 0] = 0.0
        body, skin, height = revolve(profile, 22), material("skin", rng, "wood", tone, 64), 2.2 * radius
        stalk = [[0, 0, 0.95 * height], [0.001, 0, 1.02 * height], [0.004, 0, 1.1 * height]]
        green = plain("wood", rng, 0.8 * tone)
    return prop("pepper", (body, skin), (tube(smooth(stalk, 4), 0.004, 6, up=(0, 1, 0)), green))


@family("cooking")
def carrot(rng: np.random.Generator) -> Prop:
    """Two to four carrots with their greens, side by side."""
    orange = material("skin", rng, "paint", shade([0.66, 0.21, 0.03], rng), 32)
    green = plain("leaf", rng, near([0.10, 0.22, 0.05], rng))
    parts = []
    for k in range(rng.integers(2, 5)):
        length, girth = rng.uniform(0.13, 0.18), rng.uniform(0.011, 0.015)
        s = np.linspace(0, 1, 10)
        width = girth * np.clip(1.02 - s**1.4, 0.06, 1) * np.clip(8 * s + 0.5, 0, 1)
        path = np.stack([length * s, 0.004 * np.sin(5 * s), width], 1)
        parts.append((moved(tube(path, width, 9), (0, 0.031 * k, 0), rng.normal(0, 0.05)), orange))
        for _ in range(4):
            way = np.array([-1, rng.normal(0, 0.25), 0])
            end = way * rng.uniform(0.05, 0.1) + [0, 0.031 * k, rng.uniform(0.006, 0.02)]
            frond = np.linspace([0.002, 0.031 * k, 0.01], end, 5)
            widths = np.stack([[0.0015, 0.0015, 0.006, 0.008, 0.002], np.full(5, 0.0012)], 1)
            parts.append((tube(frond, widths, 4), green))
    return prop("carrot", *parts)


@family("cooking", "dining")
def fruit_bowl(rng: np.random.Generator) -> Prop:
    """A shallow bowl heaped with apples, oranges or lemons."""
    radius, height = rng.uniform(0.1, 0.13), rng.uniform(0.045, 0.065)
    wall = smooth(
        [[0.45 * radius, 0], [0.46 * radius, 0.006], [0.8 * radius, 0.4 * height], [radius, height]], 6
    )
    parts = [
        (revolve(vessel(wall, 0.004, 0.006, 1), 28), timber(rng) if rng.uniform() < 0.3 else ceramic(rng))
    ]
    tones = np.array(
        [[0.42, 0.03, 0.03], [0.70, 0.25, 0.02], [0.72, 0.55, 0.05], [0.32, 0.42, 0.07], [0.62, 0.36, 0.2]]
    )
    kinds = rng.choice(5, 2, replace=False)
    skins = [Material(texture("speckle", rng, 32, shade(tones[k], rng)), "skin", 0.4) for k in kinds]
    ball = blob((0.068, 0.068, 0.062), 11, 7)
    for k in range(6):
        turn = 2 * np.pi * k / 5
        at = (0, 0, 0.058) if k == 5 else (0.055 * np.cos(turn), 0.055 * np.sin(turn), 0.4 * height)
        parts.append((moved(ball, at, rng.uniform(0, 6)), skins[int(rng.integers(2))]))
    return prop("fruit_bowl", *parts)


@family("cooking", "storage")
def lunch_tin(rng: np.random.Generator) -> Prop:
    """A flat tin or tub for food with a lid of another colour."""
    size = rng.uniform([0.12, 0.09, 0.04], [0.19, 0.14, 0.07])
    body, lid = (steel(rng) if rng.uniform() < 0.3 else plain("plastic", rng) for _ in range(2))
    low = extrude(np.asarray([[1, 1], [-1, 1], [-1, -1], [1, -1]]) * size[:2] / 2, size[2], 0.006)
    top = moved(box((size[0] + 0.006, size[1] + 0.006, 0.012), 0.003), (0, 0, size[2] - 0.006))
    return prop("lunch_tin", (low, body), (top, lid))
