"""Props of the washstand and the pocket: soap, sprays, toothbrushes, spectacles, keys, wallet, watch."""

from __future__ import annotations

import numpy as np

from vig_world.assets.props.containers import band_of
from vig_world.assets.props.families import family
from vig_world.assets.props.material import (
    Material,
    Prop,
    ceramic,
    dark,
    label,
    material,
    metal,
    plain,
    plastic,
    prop,
    steel,
)
from vig_world.assets.props.shapes import (
    blob,
    box,
    extrude,
    hoop,
    moved,
    revolve,
    rounded,
    smooth,
    superellipse,
    tube,
    vessel,
)
from vig_world.assets.textures import accent, near, shade
from vig_world.mesh import Mesh


@family("storage", "washing")
def spray_bottle(rng: np.random.Generator) -> Prop:
    """A bottle of cleaner with a trigger."""
    height, radius = rng.uniform(0.15, 0.19), rng.uniform(0.034, 0.042)
    outline = superellipse(24, 3.0, 1.3)
    side = smooth(
        [[radius, 0.004], [radius, 0.6 * height], [0.5 * radius, 0.85 * height], [0.36 * radius, height]], 10
    )
    profile = np.concatenate([[[0, 0], [0.94 * radius, 0]], side, [[0, height]]])
    head, body = plastic(rng), plastic(rng)
    gun = moved(box((0.085, 0.024, 0.024), 0.004), (-0.018, 0, height + 0.02))
    collar = revolve([[0, 0], [0.017, 0], [0.017, 0], [0.015, 0.024], [0, 0.024]], 16)
    trigger = smooth(
        [[-0.03, 0, height + 0.022], [-0.042, 0, height + 0.002], [-0.036, 0, height - 0.025]], 5
    )
    nozzle = moved(
        revolve([[0, 0], [0.009, 0], [0.009, 0], [0.008, 0.014], [0, 0.014]], 12),
        (-0.06, 0, height + 0.032),
        -np.pi / 2,
        np.pi / 2,
    )
    return prop(
        "spray_bottle",
        (revolve(profile, 24, outline), body),
        (band_of(1.006 * radius, 0.08 * height, 0.56 * height, outline, 24), label(rng)),
        (gun, head),
        (moved(collar, (0, 0, height - 0.003)), head),
        (tube(trigger, np.full((5, 2), [0.003, 0.008]), 6, up=(0, 1, 0)), head),
        (nozzle, plain("plastic", rng, accent(rng))),
    )


@family("washing")
def soap_dispenser(rng: np.random.Generator) -> Prop:
    """A dispenser of soap or lotion with a pump."""
    height, radius = rng.uniform(0.09, 0.14), rng.uniform(0.028, 0.038)
    outline = superellipse(26, float(rng.choice([2.0, 2.0, 5.0])))
    side = smooth(
        [[radius, 0.003], [radius, 0.5 * height], [0.96 * radius, 0.86 * height], [0.5 * radius, height]], 9
    )
    profile = np.concatenate([[[0, 0], [0.95 * radius, 0]], side, [[0, height]]])
    body = ceramic(rng) if rng.uniform() < 0.5 else plastic(rng)
    pump = steel(rng) if rng.uniform() < 0.5 else plastic(rng)
    neck = [
        [0, 0],
        [0.015, 0],
        [0.015, 0.012],
        [0.006, 0.014],
        [0.006, 0.034],
        [0.012, 0.036],
        [0.012, 0.046],
        [0, 0.048],
    ]
    spout = smooth([[0, 0, 0.041], [-0.03, 0, 0.042], [-0.042, 0, 0.036]], 6)
    parts = [(revolve(profile, 26, outline), body), (moved(revolve(neck, 16), (0, 0, height - 0.001)), pump)]
    parts.append((moved(tube(spout, 0.0045, 6, up=(0, 1, 0)), (0, 0, height)), pump))
    if rng.uniform() < 0.5:
        parts.append((band_of(1.008 * radius, 0.2 * height, 0.72 * height, outline, 26), label(rng)))
    return prop("soap_dispenser", *parts)


@family("washing")
def toothbrush_cup(rng: np.random.Generator) -> Prop:
    """A cup with toothbrushes, and perhaps toothpaste."""
    height, radius = rng.uniform(0.08, 0.11), rng.uniform(0.032, 0.04)
    wall = np.linspace([0.85 * radius, 0], [radius, height], 4)
    parts = [
        (revolve(vessel(wall, 0.003, 0.005, 1), 24), ceramic(rng) if rng.uniform() < 0.6 else plastic(rng))
    ]
    for _ in range(rng.integers(1, 4)):
        turn, lean = rng.uniform(0, 2 * np.pi), rng.uniform(0.4, 0.85) * radius
        side = np.array([np.cos(turn), np.sin(turn), 0])
        foot, rim = np.array([0, 0, 0.006]) - 0.5 * lean * side, lean * side + [0, 0, height]
        way = (rim - foot) / np.linalg.norm(rim - foot)
        path = foot + np.array([0, 0.1, 0.14, 0.185])[:, None] * way
        across = np.array([-np.sin(turn), np.cos(turn), 0])
        parts.append(
            (
                tube(
                    path,
                    np.array([[0.0045, 0.004], [0.004, 0.004], [0.0025, 0.003], [0.003, 0.005]]),
                    6,
                    up=across,
                ),
                plastic(rng),
            )
        )
        head = np.array([0.155, 0.185])[:, None] * way + foot + 0.007 * side
        parts.append(
            (tube(head, np.array([0.005, 0.005]), 4, up=across), plain("plastic", rng, [0.8, 0.8, 0.79]))
        )
    return prop("toothbrush_cup", *parts)


@family("washing")
def soap(rng: np.random.Generator) -> Prop:
    """A bar of soap in its dish, or a sponge."""
    tint = shade(
        [[0.76, 0.70, 0.58], [0.36, 0.44, 0.30], [0.62, 0.42, 0.42], [0.78, 0.77, 0.74]][rng.integers(4)], rng
    )
    if rng.uniform() < 0.4:
        size = rng.uniform([0.09, 0.06, 0.03], [0.12, 0.075, 0.045])
        sponge = material("cloth", rng, "cork", accent(rng), 48)
        pad = box((size[0], size[1], 0.008), 0.001)
        return prop(
            "soap",
            (moved(box(size, 0.004), (0, 0, 0.008)), sponge),
            (pad, plain("cloth", rng, [0.10, 0.20, 0.08])),
        )
    wall = smooth([[0.035, 0], [0.05, 0.004], [0.062, 0.018]], 5)
    dish = revolve(vessel(wall, 0.003, 0.004, 1), 26, superellipse(26, 2.4, 1.35))
    bar = moved(blob((0.055, 0.078, 0.026), 18, 7, 3.0), (0, 0, 0.005))
    return prop("soap", (dish, ceramic(rng)), (bar, plain("wax", rng, tint)))


@family("bedside", "washing")
def tube_paste(rng: np.random.Generator) -> Prop:
    """A tube of cream or toothpaste, lying."""
    length, width = rng.uniform(0.12, 0.17), rng.uniform(0.02, 0.028)
    s = np.linspace(0, 1, 8)
    thick = 0.0015 + (0.42 * width) * np.sqrt(s)
    wide = width * (1.15 - 0.25 * s)
    path = np.stack([0 * s, length * s, np.full(8, thick[-1]) * s + thick * (1 - s)], 1)
    body = tube(path, np.stack([wide, thick], 1), 12)
    cap = [[0, 0], [0.5 * width, 0], [0.5 * width, 0], [0.45 * width, 0.02], [0, 0.02]]
    lid = moved(revolve(cap, 14), (0, length, thick[-1]), tilt=-np.pi / 2)
    return prop("tube_paste", (body, label(rng)), (lid, plastic(rng)))


@family("desk", "reading", "bedside")
def spectacles(rng: np.random.Generator) -> Prop:
    """A pair of glasses lying on their rims with the arms open, or folded."""
    frame = (
        dark(rng)
        if rng.uniform() < 0.5
        else metal(rng)
        if rng.uniform() < 0.6
        else material("plastic", rng, "marble", [0.22, 0.10, 0.04], 32)
    )
    glass = plain("glass", rng, np.full(3, 0.03) if rng.uniform() < 0.4 else shade([0.42, 0.44, 0.45], rng))
    wide, high, thick = rng.uniform(0.046, 0.054), rng.uniform(0.034, 0.046), rng.uniform(0.0012, 0.0028)
    rim = rounded(wide, high, 0.49 * high if rng.uniform() < 0.4 else 0.3 * high, 5)
    parts: list[tuple[Mesh, Material]] = []
    for side in (-1, 1):
        at = (side * (wide / 2 + 0.009), 0, 0)
        ring = np.column_stack([rim[:, 0], np.zeros(len(rim)), rim[:, 1] + high / 2 + thick])
        parts.append((moved(hoop(ring, thick, 5, up=(0, 1, 0)), at), frame))
        pane = moved(extrude(rim * 0.97, 0.0012), (0, 0.0006, high / 2 + thick), tilt=np.pi / 2)
        parts.append((moved(pane, at), glass))
        outer = side * (wide + 0.01)
        arm = smooth(
            [
                [outer, 0, 0.72 * high],
                [outer, 0.05, 0.7 * high],
                [outer, 0.095, 0.62 * high],
                [outer * 0.97, 0.135, thick],
            ],
            9,
        )
        parts.append((tube(arm, np.full((9, 2), [0.0012, 0.0022]), 6), frame))
    bridge = smooth([[-0.01, 0, 0.6 * high], [0, 0, 0.72 * high], [0.01, 0, 0.6 * high]], 5)
    parts.append((tube(bridge, thick, 5, up=(0, 1, 0)), frame))
    return prop("spectacles", *parts)


@family("desk", "bedside")
def keys(rng: np.random.Generator) -> Prop:
    """A bunch of keys on a ring with a tag."""
    t = np.linspace(0, 2 * np.pi, 20, endpoint=False)
    ring = np.stack([0.015 * np.cos(t), 0.015 * np.sin(t), np.full(20, 0.0035)], 1)
    parts = [(hoop(ring, 0.0012, 5), steel(rng))]
    for k in range(rng.integers(2, 5)):
        turn = 0.7 * k + rng.normal(0, 0.15)
        alloy, z = metal(rng), 0.002 * k
        length = rng.uniform(0.028, 0.038)
        bow = extrude(rounded(0.024, 0.021, 0.009), 0.002)
        shaft = box((0.007, length, 0.0018))
        for mesh, y in ((bow, 0.026), (shaft, 0.035 + length / 2)):
            parts.append((moved(moved(mesh, (0, y, z)), turn=turn), alloy))
        for j in range(3):
            tooth = box((0.004, 0.004, 0.0018))
            parts.append((moved(moved(tooth, (0.0045, 0.05 + 0.007 * j, z)), turn=turn), alloy))
    tag = extrude(rounded(0.026, 0.045, 0.012), 0.004, 0.001)
    leather = material("cloth", rng, "leather", accent(rng), 32)
    parts.append((moved(moved(tag, (0, 0.038, 0)), turn=-rng.uniform(0.8, 2.5)), leather))
    return prop("keys", *parts)


@family("desk")
def wallet(rng: np.random.Generator) -> Prop:
    """A purse or wallet, shut."""
    width, depth, thick = rng.uniform([0.095, 0.08, 0.014], [0.19, 0.1, 0.026])
    hide = material("cloth", rng, "leather", None if rng.uniform() < 0.6 else accent(rng), 64)
    half = extrude(rounded(width, depth, 0.007), 0.47 * thick, 0.003)
    parts = [(half, hide), (moved(half, (rng.normal(0, 0.0015), 0, 0.53 * thick)), hide)]
    parts.append(
        (box((0.96 * width, 0.96 * depth, thick * 0.9)), plain("cloth", rng, hide.texture.mean((0, 1)) * 0.5))
    )
    if rng.uniform() < 0.5:
        parts.append(
            (
                moved(
                    revolve([[0, 0], [0.007, 0], [0.006, 0.002], [0, 0.003]], 12),
                    (0, -0.36 * depth, thick - 0.0005),
                ),
                metal(rng),
            )
        )
    return prop("wallet", *parts)


@family("bedside")
def watch(rng: np.random.Generator) -> Prop:
    """A wrist watch, lying on its side with the strap closed."""
    radius, wide = rng.uniform(0.028, 0.033), rng.uniform(0.014, 0.02)
    t = np.linspace(0, 2 * np.pi, 26, endpoint=False)
    loop = np.stack([radius * np.cos(t), 0.85 * radius * np.sin(t), np.full(26, wide / 2 + 0.006)], 1)
    strap = material("cloth", rng, "leather", None, 32) if rng.uniform() < 0.6 else steel(rng)
    parts = [(hoop(loop, (0.0016, wide / 2), 8), strap)]
    case = revolve(
        [
            [0, 0],
            [0.018, 0],
            [0.0195, 0.002],
            [0.0195, 0.007],
            [0.017, 0.0095],
            [0.0165, 0.0085],
            [0, 0.0085],
        ],
        22,
    )
    face = revolve([[0, 0.008], [0.0163, 0.008], [0.0163, 0.0089], [0, 0.0089]], 18)
    dial = plain("paper", rng, [0.75, 0.74, 0.70] if rng.uniform() < 0.6 else [0.04, 0.05, 0.08])
    for mesh, m in ((case, metal(rng)), (face, dial)):
        parts.append((moved(mesh, (0, -0.85 * radius, wide / 2 + 0.0105), tilt=np.pi / 2), m))
    ink = dark(rng) if dial.texture.mean() > 0.3 else plain("plastic", rng, [0.7, 0.7, 0.7])
    for turn, reach in ((0.6, 0.008), (2.9, 0.012)):
        hand = moved(box((0.0012, reach, 0.0004)), (0, reach / 2, 0.0089))
        parts.append(
            (moved(moved(hand, turn=turn), (0, -0.85 * radius, wide / 2 + 0.0105), tilt=np.pi / 2), ink)
        )
    tilt = -np.arctan2(0.015 - wide / 2, 1.7 * radius)  # it rests on the case and on the strap's far side
    return prop("watch", *[(moved(mesh, tilt=tilt), m) for mesh, m in parts])


@family("bedside", "washing")
def hairbrush(rng: np.random.Generator) -> Prop:
    """A hairbrush, lying on its bristles."""
    skin = material("wood", rng, "wood", None, 32) if rng.uniform() < 0.5 else plastic(rng)
    s = np.linspace(0, 1, 15)
    wide = np.where(
        s < 0.5,
        0.009 + 0.003 * np.sin(6 * s),
        0.034 * np.sqrt(np.clip(1 - ((s - 0.75) / 0.262) ** 2, 0.02, 1)),
    )
    path = np.stack([0 * s, 0.22 * s, 0.024 - 0.004 * np.sin(np.pi * s)], 1)
    parts = [(tube(path, np.stack([wide, np.full(15, 0.0065)], 1), 8), skin)]
    pad = moved(blob((0.05, 0.085, 0.022), 14, 6, 2.6), (0, 0.165, 0.0))
    parts.append((pad, material("plastic", rng, "speckle", near([0.05, 0.05, 0.05], rng), 32)))
    parts.append((moved(blob((0.016, 0.03, 0.022), 8, 5), (0, 0.012, 0)), skin))
    return prop("hairbrush", *parts)


@family("bedside", "washing")
def perfume(rng: np.random.Generator) -> Prop:
    """A bottle of perfume or nail varnish."""
    height, radius = rng.uniform(0.04, 0.08), rng.uniform(0.02, 0.032)
    outline = superellipse(26, float(rng.choice([2.0, 6.0, 10.0])), rng.uniform(1.0, 1.7))
    profile = [
        [0, 0],
        [radius, 0],
        [radius, 0.003],
        [radius, height - 0.006],
        [0.9 * radius, height],
        [0.3 * radius, height],
        [0, height],
    ]
    cap = [
        [0, 0],
        [0.36 * radius, 0],
        [0.36 * radius, 0],
        [0.36 * radius, 0.024],
        [0.3 * radius, 0.028],
        [0, 0.028],
    ]
    fluid = shade(
        [[0.66, 0.48, 0.28], [0.60, 0.38, 0.38], [0.38, 0.46, 0.50], [0.04, 0.04, 0.05]][rng.integers(4)], rng
    )
    parts = [
        (revolve(profile, 26, outline), plain("glass", rng, fluid)),
        (moved(revolve(cap, 18), (0, 0, height - 0.0005)), metal(rng) if rng.uniform() < 0.6 else dark(rng)),
    ]
    if rng.uniform() < 0.6:
        parts.append((band_of(1.012 * radius, 0.25 * height, 0.7 * height, outline, 26), label(rng)))
    return prop("perfume", *parts)
