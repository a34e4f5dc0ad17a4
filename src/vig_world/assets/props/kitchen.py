"""Props of the kitchen: boards, pots and pans, kettle, toaster, utensils, egg box."""

from __future__ import annotations

import numpy as np

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
    timber,
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
    tube,
    vessel,
)
from vig_world.assets.textures import accent, near, shade
from vig_world.mesh import Mesh


@family("cooking")
def cutting_board(rng: np.random.Generator) -> Prop:
    """A board to cut on, with a grip or without, lying; perhaps a knife on it."""
    width, depth, thick = rng.uniform(0.12, 0.2), rng.uniform(0.2, 0.29), rng.uniform(0.01, 0.025)
    wood = timber(rng, 128) if rng.uniform() < 0.75 else plastic(rng)
    board = extrude(rounded(width, depth, rng.uniform(0.006, 0.04)), thick, 0.002)
    parts = [(board, wood)]
    if depth < 0.25:
        grip = extrude(rounded(0.03, 0.1, 0.014), thick, 0.002)
        parts.append((moved(grip, (0, depth / 2 + 0.03, 0)), wood))
    if rng.uniform() < 0.5:
        parts += [(moved(mesh, (0.02, -0.1, thick), rng.uniform(-0.6, 0.6)), m) for mesh, m in _knife(rng)]
    return prop("cutting_board", *parts)


def _knife(rng: np.random.Generator) -> list[tuple[Mesh, Material]]:
    """A kitchen knife along +Y, lying on z = 0."""
    blade = [[-0.001, 0.08], [0.018, 0.085], [0.019, 0.12], [0.012, 0.17], [-0.001, 0.2], [-0.001, 0.2]]
    hilt = extrude(rounded(0.02, 0.1, 0.006), 0.012, 0.003)
    return [
        (moved(extrude(blade, 0.002), (0, 0, 0.004)), steel(rng)),
        (moved(hilt, (0.006, 0.04, 0)), timber(rng, 32) if rng.uniform() < 0.5 else dark(rng)),
    ]


def _lid(
    radius: float, height: float, dome: float, stuff: Material, knob: Material
) -> list[tuple[Mesh, Material]]:
    """A domed lid with a knob whose edge lies at `height`."""
    curve = smooth([[radius, 0], [0.9 * radius, 0.45 * dome], [0.5 * radius, 0.85 * dome], [0.008, dome]], 8)
    profile = np.concatenate([[[0, 0], curve[0]], curve, [[0, dome]]])
    ball = [[0, 0], [0.008, 0], [0.007, 0.008], [0.014, 0.014], [0.012, 0.02], [0, 0.022]]
    return [
        (moved(revolve(profile, 28), (0, 0, height)), stuff),
        (moved(revolve(ball, 14), (0, 0, height + dome - 0.001)), knob),
    ]


def _enamel(rng: np.random.Generator) -> Material:
    """What pots are made of: steel, enamel, cast iron, copper."""
    choice = rng.uniform()
    if choice < 0.4:
        return steel(rng)
    if choice < 0.75:
        return plain("ceramic", rng, accent(rng) if rng.uniform() < 0.6 else shade([0.75, 0.73, 0.68], rng))
    return metal(rng) if choice < 0.85 else dark(rng)


@family("cooking", "storage")
def saucepan(rng: np.random.Generator) -> Prop:
    """A saucepan with a long handle, or a pot with two ears; with its lid or open."""
    radius, height = rng.uniform(0.065, 0.1), rng.uniform(0.06, 0.12)
    wall = [
        [0.93 * radius, 0],
        [radius, 0.012],
        [radius, 0.5 * height],
        [radius, height],
        [1.03 * radius, height],
    ]
    pot, knob = _enamel(rng), dark(rng) if rng.uniform() < 0.6 else steel(rng)
    parts = [(revolve(vessel(wall, 0.004, 0.005, 1), 30), pot)]
    if rng.uniform() < 0.6:
        parts += _lid(radius, height, rng.uniform(0.012, 0.03), pot, knob)
    if rng.uniform() < 0.55:
        reach = rng.uniform(0.11, 0.15)
        path = [
            [radius, 0, 0.8 * height],
            [radius + 0.03, 0, 0.85 * height],
            [radius + reach, 0, 0.95 * height],
        ]
        parts.append((tube(smooth(path, 6), np.full((6, 2), [0.008, 0.006]), 6, up=(0, 1, 0)), knob))
    else:
        for turn in (0, np.pi):
            ear = smooth(
                [
                    [0.97 * radius, -0.03, 0],
                    [radius + 0.028, -0.02, 0.006],
                    [radius + 0.028, 0.02, 0.006],
                    [0.97 * radius, 0.03, 0],
                ],
                9,
            )
            parts.append(
                (
                    moved(tube(ear, 0.005, 6), (0, 0, 0.75 * height), turn),
                    knob if rng.uniform() < 0.3 else pot,
                )
            )
    return prop("saucepan", *parts)


@family("cooking")
def frying_pan(rng: np.random.Generator) -> Prop:
    """A frying pan."""
    radius, height = rng.uniform(0.075, 0.11), rng.uniform(0.03, 0.045)
    wall = smooth([[0.75 * radius, 0], [0.85 * radius, 0.2 * height], [radius, height]], 6)
    iron = plain("metal", rng, np.full(3, rng.uniform(0.02, 0.09))) if rng.uniform() < 0.7 else metal(rng)
    path = smooth([[0.93 * radius, 0, 0.7 * height], [radius + 0.03, 0, 0.95 * height],
                   [radius + rng.uniform(0.12, 0.15), 0, 1.5 * height]], 7)  # fmt: skip
    grip = tube(
        path, np.stack([np.linspace(0.006, 0.007, 7), np.linspace(0.009, 0.014, 7)], 1), 6, up=(0, 1, 0)
    )
    handle = iron if rng.uniform() < 0.4 else dark(rng) if rng.uniform() < 0.6 else timber(rng, 32)
    return prop("frying_pan", (revolve(vessel(wall, 0.003, 0.004, 1), 32), iron), (grip, handle))


@family("cooking", "drinks")
def kettle(rng: np.random.Generator) -> Prop:
    """A kettle: for the stove with a bail over the top, or electric with a handle at the side."""
    height, radius = rng.uniform(0.1, 0.17), rng.uniform(0.065, 0.085)
    top = radius * rng.uniform(0.5, 0.75)
    side = smooth(
        [[0.92 * radius, 0], [radius, 0.08 * height], [0.97 * radius, 0.4 * height], [top, height]], 9
    )
    body = np.concatenate([[[0, 0], side[0]], side, [[0, height]]])
    shell = _enamel(rng)
    black = dark(rng) if rng.uniform() < 0.7 else timber(rng, 32)
    parts = [(revolve(body, 28), shell), *_lid(0.9 * top, height - 0.002, 0.012, shell, black)]
    spout = smooth([[-0.8 * radius, 0, 0.45 * height], [-1.15 * radius, 0, 0.6 * height],
                    [-1.35 * radius, 0, 0.95 * height]], 7)  # fmt: skip
    parts.append((tube(spout, np.linspace(0.018, 0.009, 7), 8, up=(0, 1, 0)), shell))
    if rng.uniform() < 0.5:  # a bail
        turn = np.linspace(0.12, np.pi - 0.12, 11)
        rise = rng.uniform(0.06, 0.09)
        arc = np.stack(
            [0.85 * radius * np.cos(turn), 0 * turn, 0.85 * height + 0.1 * rise + rise * np.sin(turn)], 1
        )
        parts.append((tube(arc, np.full((11, 2), [0.004, 0.008]), 6, up=(0, 1, 0)), black))
    else:
        arc = smooth([[0.8 * top, 0, 0.97 * height], [radius + 0.035, 0, 0.95 * height],
                      [radius + 0.038, 0, 0.5 * height], [0.95 * radius, 0, 0.25 * height]], 10)  # fmt: skip
        parts.append((tube(arc, np.full((10, 2), [0.008, 0.011]), 6, up=(0, 1, 0)), black))
    return prop("kettle", *parts)


@family("cooking")
def utensils(rng: np.random.Generator) -> Prop:
    """A whisk, ladle, spatula or wooden spoon, or two of them, lying."""
    parts: list[tuple[Mesh, Material]] = []
    for i, kind in enumerate(rng.permutation(4)[: rng.integers(1, 3)]):
        stuff = timber(rng, 32) if kind == 3 else steel(rng)
        grip = stuff if rng.uniform() < 0.4 else dark(rng)
        made = [(tube(np.linspace([0, 0, 0.008], [0, 0.12, 0.008], 3), 0.008, 8), grip)]
        if kind == 0:  # whisk
            for turn in np.pi * np.arange(4) / 4:
                t = np.linspace(0, 2 * np.pi, 14, endpoint=False)
                swell = 0.026 * np.sin(t) * (0.7 - 0.3 * np.cos(t))
                loop = np.stack(
                    [swell * np.cos(turn), 0.17 - 0.06 * np.cos(t), 0.0215 + swell * np.sin(turn)], 1
                )
                made.append((hoop(loop, 0.0011, 4, up=(np.sin(turn), 0, -np.cos(turn))), stuff))
            sloping = tube(np.linspace([0, 0, 0.008], [0, 0.12, 0.0215], 3), 0.008, 8)
            made = [(sloping, grip), *made[1:]]
        else:
            end = {1: 0.2, 2: 0.19, 3: 0.2}[int(kind)]
            made.append(
                (tube(np.linspace([0, 0.11, 0.008], [0, end, 0.006], 3), [0.004, 0.003, 0.003], 6), stuff)
            )
            if kind == 1:  # ladle
                cup = revolve(vessel([[0.01, 0], [0.028, 0.01], [0.034, 0.026]], 0.002, 0.002, 1), 16)
                made.append((moved(cup, (0, end + 0.025, 0)), stuff))
            elif kind == 2:  # spatula
                blade = extrude(rounded(0.07, 0.09, 0.01), 0.0025)
                made.append((moved(blade, (0, end + 0.035, 0.001)), stuff))
            else:  # spoon
                made.append((moved(blob((0.05, 0.075, 0.014), 12, 6), (0, end + 0.03, 0)), stuff))
        turn = rng.normal(0, 0.15)
        parts += [(moved(mesh, (0.075 * i, 0, 0), turn), m) for mesh, m in made]
    return prop("utensils", *parts)


@family("cooking")
def toaster(rng: np.random.Generator) -> Prop:
    """A toaster with two slots, perhaps with toast in them."""
    width, depth, height = rng.uniform([0.24, 0.14, 0.16], [0.29, 0.18, 0.2])
    shell = _enamel(rng)
    black = dark(rng)
    body = moved(
        extrude(rounded(depth, height, 0.04, 5), width, 0.006),
        (0, 0, height / 2 + 0.008),
        np.pi / 2,
        np.pi / 2,
    )
    parts = [(moved(body, (-width / 2, 0, 0)), shell), (box((0.94 * width, 0.8 * depth, 0.01)), black)]
    bread = material("skin", rng, "speckle", near([0.42, 0.22, 0.08], rng), 32)
    toast = rng.uniform() < 0.4
    for y in (-0.22 * depth, 0.22 * depth):
        parts.append((moved(box((0.72 * width, 0.03, 0.004)), (0, y, height + 0.005)), black))
        if toast:
            slice_ = moved(
                extrude(rounded(0.6 * width, 0.05, 0.015), 0.014, 0.002),
                (0, y + 0.007, height + 0.012),
                0,
                np.pi / 2,
            )
            parts.append((slice_, bread))
    lever = box((0.012, 0.03, 0.014), 0.003)
    parts.append((moved(lever, (width / 2 + 0.005, 0, 0.6 * height)), black))
    return prop("toaster", *parts)


@family("cooking")
def egg_box(rng: np.random.Generator) -> Prop:
    """An open tray of eggs, or a closed box of them."""
    columns = int(rng.choice([3, 5]))
    pulp = material(
        "paper",
        rng,
        "speckle",
        shade(np.array([[0.38, 0.36, 0.33], [0.30, 0.36, 0.42]])[rng.integers(2)], rng),
        32,
    )
    width, depth = 0.05 * columns + 0.01, 0.11
    foot = extrude(rounded(width, depth, 0.012), 0.034, 0.006)
    parts = [(foot, pulp)]
    if rng.uniform() < 0.4:
        parts.append((moved(extrude(rounded(width, depth, 0.012), 0.034, 0.012), (0, 0, 0.033)), pulp))
        sheet = box((0.8 * width, 0.7 * depth, 0.001))
        parts.append((moved(sheet, (0, 0, 0.0665)), label(rng)))
        return prop("egg_box", *parts)
    shells = [
        material("skin", rng, "speckle", shade(c, rng), 16) for c in ([0.62, 0.38, 0.22], [0.8, 0.77, 0.7])
    ]
    tone = rng.integers(2)
    egg = blob((0.042, 0.042, 0.056), 10, 7)
    for k in range(2 * columns):
        if rng.uniform() < 0.8:
            at = (0.05 * (k // 2 - (columns - 1) / 2), 0.05 * (k % 2 - 0.5), 0.016)
            parts.append((moved(egg, at), shells[tone if rng.uniform() < 0.85 else 1 - tone]))
    return prop("egg_box", *parts)


@family("cooking")
def rolling_pin(rng: np.random.Generator) -> Prop:
    """A rolling pin."""
    length, radius = rng.uniform(0.2, 0.25), rng.uniform(0.02, 0.028)
    end = length / 2
    profile = [[0, -end - 0.035], [0.008, -end - 0.033], [0.011, -end - 0.02], [0.006, -end], [0.006, -end],
               [radius, -end], [radius, -end], [radius, end], [radius, end], [0.006, end], [0.006, end],
               [0.011, end + 0.02], [0.008, end + 0.033], [0, end + 0.035]]  # fmt: skip
    return prop("rolling_pin", (moved(revolve(profile, 20), tilt=np.pi / 2), timber(rng)))


@family("cooking", "dining", "drinks")
def tray(rng: np.random.Generator) -> Prop:
    """A tray of wood, lacquer or metal with a raised edge."""
    width, depth, edge = rng.uniform(0.2, 0.3), rng.uniform(0.15, 0.21), rng.uniform(0.012, 0.03)
    stuff = timber(rng, 128) if rng.uniform() < 0.5 else plastic(rng) if rng.uniform() < 0.6 else metal(rng)
    parts = [(extrude(rounded(width, depth, 0.02), 0.005), stuff)]
    loop = np.column_stack([rounded(width - 0.008, depth - 0.008, 0.016, 5), np.full(20, edge / 2)])
    parts.append((hoop(loop, (0.004, edge / 2), 6), stuff if rng.uniform() < 0.7 else ceramic(rng)))
    return prop("tray", *parts)
