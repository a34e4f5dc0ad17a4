"""Props of cloth, cork and straw: coasters, place mat, runner, tea towel, basket, hat, shoe, teddy, wool."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from vig_world.assets.props.families import family
from vig_world.assets.props.material import Material, Prop, dark, material, plain, prop, timber
from vig_world.assets.props.shapes import (
    blob,
    box,
    extrude,
    hoop,
    moved,
    relief,
    revolve,
    rounded,
    scaled,
    smooth,
    superellipse,
    tube,
)
from vig_world.assets.textures import accent, neutral, noise, shade
from vig_world.mesh import Mesh

_WOVEN = ("cloth", "cloth", "stripes", "floral", "paint", "weave")


def _fabric(rng: np.random.Generator, size: int = 96) -> Material:
    return material("cloth", rng, str(rng.choice(_WOVEN)), None, size)


def _fine_weave(kind: str, rng: np.random.Generator, base: ArrayLike | None) -> Material:
    """Wickerwork or straw of fine strands."""
    coarse = material(kind, rng, "weave", base, 48)
    return replace(coarse, texture=np.tile(coarse.texture, (2, 2, 1)))


@family("dining", "drinks", "reading")
def coaster(rng: np.random.Generator) -> Prop:
    """One to four coasters of cork, wood, slate or felt: scattered or stacked."""
    side, thick = rng.uniform(0.085, 0.105), rng.uniform(0.003, 0.009)
    shape = rounded(side, side, side / 2 - 0.001 if rng.uniform() < 0.5 else 0.008, 6)
    kind, pattern = (
        ("wood", "cork"),
        ("wood", "wood"),
        ("earth", "concrete"),
        ("cloth", "paint"),
        ("paper", "print"),
    )[rng.integers(5)]
    stuff = material(kind, rng, pattern, None, 64)
    spread = rng.uniform() < 0.4
    parts = []
    for k in range(rng.integers(1, 5)):
        at = (
            (1.08 * side * (k % 2), 1.08 * side * (k // 2), 0)
            if spread
            else (*rng.normal(0, 0.002, 2), k * thick)
        )
        parts.append((moved(extrude(shape, thick, 0.001), at, rng.normal(0, 0.1)), stuff))
    return prop("coaster", *parts)


def _lying(
    rng: np.random.Generator, width: float, depth: float, thick: float, wave: float, n: int = 14
) -> Mesh:
    """A cloth spread on a table, with a few soft folds that rise by up to `wave`."""
    s, t = np.meshgrid(np.linspace(-1, 1, n), np.linspace(-1, 1, n))
    along = rng.uniform(0, np.pi)
    phase = rng.uniform(2, 4) * (np.cos(along) * s + np.sin(along) * t) + 0.6 * noise(rng, 32, 2.2)[:n, :n]
    rise = wave * np.maximum(np.sin(phase + rng.uniform(0, 6)), 0) ** 3
    x, y = s * width / 2, t * depth / 2 + 0.012 * depth * np.sin(2 * s + rng.uniform(0, 6))
    return relief(x, y, rise + thick, rise * 0.98)


@family("dining")
def place_mat(rng: np.random.Generator) -> Prop:
    """A place mat: woven, of cork, felt or printed; oblong or round."""
    kind, pattern = (
        ("cloth", "weave"),
        ("cloth", "stripes"),
        ("wood", "cork"),
        ("plastic", "print"),
        ("cloth", "cloth"),
    )[rng.integers(5)]
    stuff = material(kind, rng, pattern, None, 128 if pattern != "cork" else 64)
    thick = rng.uniform(0.002, 0.004)
    if rng.uniform() < 0.3:
        size = rng.uniform(0.22, 0.3)
        return prop("place_mat", (extrude(rounded(size, size, size / 2 - 0.001, 8), thick, 0.0008), stuff))
    width, depth = rng.uniform(0.26, 0.31), rng.uniform(0.19, 0.22)
    return prop("place_mat", (extrude(rounded(width, depth, rng.uniform(0.002, 0.02)), thick, 0.0008), stuff))


@family("dining", "drinks")
def table_runner(rng: np.random.Generator) -> Prop:
    """A runner or small tablecloth spread out."""
    width, depth = rng.uniform(0.16, 0.22), rng.uniform(0.34, 0.48)
    return prop(
        "table_runner", (_lying(rng, width, depth, 0.0025, rng.uniform(0.0, 0.006)), _fabric(rng, 128))
    )


@family("cooking", "dining", "washing")
def tea_towel(rng: np.random.Generator) -> Prop:
    """A tea towel or scarf let fall: gathered in the middle into ridges."""
    n = 17
    s, t = np.meshgrid(np.linspace(-1, 1, n), np.linspace(-1, 1, n))
    width, depth = rng.uniform(0.07, 0.12), rng.uniform(0.11, 0.15)
    ridges = rng.uniform(4, 8)
    sway = rng.uniform(-0.03, 0.03) * np.sin(2 * t)
    gathered = 1 - rng.uniform(0.2, 0.5) * np.exp(-2 * t**2)
    rise = (0.5 + 0.5 * np.sin(ridges * s + 0.8 * t + 0.5 * noise(rng, 32, 2.0)[:n, :n])) * rng.uniform(
        0.012, 0.026
    )
    rise = rise * (0.35 + 0.65 * np.exp(-1.5 * t**2)) * (1 - 0.7 * s**4)
    mesh = relief(width * s * gathered + sway, depth * t + 0.01 * np.sin(3 * s), rise + 0.002, 0.0)
    return prop("tea_towel", (mesh, _fabric(rng, 128)))


@family("cooking", "dining", "display", "storage", "washing", "floor")
def basket(rng: np.random.Generator) -> Prop:
    """A wicker basket, round or oblong, with a handle or without; bread or fruit may lie in it."""
    radius, height = rng.uniform(0.08, 0.115), rng.uniform(0.05, 0.1)
    outline = superellipse(28, float(rng.choice([2.0, 4.0])), rng.uniform(0.75, 1.0))
    low = 0.82 * radius
    loop = [
        [0, 0],
        [low, 0],
        [low, 0],
        [radius, height],
        [radius, height + 0.004],
        [radius - 0.008, height + 0.004],
        [radius - 0.008, height],
        [low - 0.006, 0.008],
        [low - 0.006, 0.008],
        [0, 0.008],
    ]
    wicker = _fine_weave("wood", rng, None)
    parts = [(revolve(loop, 28, outline), wicker)]
    t = np.linspace(0, 2 * np.pi, 28, endpoint=False)
    reach = (radius - 0.003) * np.roll(outline, 14)
    edge = np.stack([reach * np.cos(t), reach * np.sin(t), np.full(28, height + 0.002)], 1)
    parts.append((hoop(edge, 0.006, 6), wicker))
    if rng.uniform() < 0.4:
        arc = np.linspace(0.05, np.pi - 0.05, 13)
        bail = np.stack(
            [0 * arc, 0.97 * radius * np.cos(arc), 0.9 * height + rng.uniform(0.08, 0.13) * np.sin(arc)], 1
        )
        parts.append((tube(bail, 0.006, 6, up=(1, 0, 0)), wicker))
    if rng.uniform() < 0.5:
        cloth = _lying(rng, 1.15 * radius, 1.15 * radius, 0.01, 0.03, 10)
        parts.append((moved(cloth, (0, 0, 0.5 * height)), _fabric(rng, 64)))
    return prop("basket", *parts)


@family("storage", "floor")
def hat(rng: np.random.Generator) -> Prop:
    """A hat with a brim and a band."""
    crown, height, brim = rng.uniform(0.07, 0.08), rng.uniform(0.085, 0.11), rng.uniform(0.035, 0.065)
    side = smooth(
        [
            [crown + brim, 0.004],
            [crown + 0.5 * brim, 0.003],
            [crown + 0.004, 0.006],
            [0.96 * crown, 0.5 * height],
            [0.86 * crown, 0.93 * height],
            [0.6 * crown, height],
            [0.2 * crown, 0.93 * height],
            [0, 0.91 * height],
        ],
        18,
    )
    side[-1, 0] = 0.0
    profile = np.concatenate([[[0, 0], [crown + 0.9 * brim, 0], [crown + brim, 0.002]], side])
    oval = superellipse(28, 2.0, 0.85)
    if rng.uniform() < 0.6:
        felt = _fine_weave("cloth", rng, shade([0.62, 0.48, 0.28], rng))
    else:
        felt = material("cloth", rng, "speckle", neutral(rng), 64)
    band = [
        [0.9 * crown, 0.01],
        [1.012 * crown, 0.01],
        [1.0 * crown, 0.034],
        [0.9 * crown, 0.034],
        [0.9 * crown, 0.01],
    ]
    return prop("hat", (revolve(profile, 28, oval), felt), (revolve(band, 28, oval), plain("cloth", rng)))


@family("floor")
def shoe(rng: np.random.Generator) -> Prop:
    """A shoe with laces."""
    length = rng.uniform(0.22, 0.28)
    leather = material("cloth", rng, str(rng.choice(["leather", "leather", "paint", "cloth"])), None, 64)
    t = np.linspace(0, 2 * np.pi, 26, endpoint=False)
    wide = 0.042 * (1 - 0.16 * np.cos(t))
    foot = np.stack([length / 2 * np.cos(t), wide * np.sin(t) * (1 + 0.12 * np.cos(t - 0.8))], 1)
    sole = plain("plastic", rng, shade([0.75, 0.73, 0.70], rng)) if rng.uniform() < 0.5 else dark(rng)
    levels = np.linspace(0, 1, 7)
    heel = np.clip((0.35 - foot[:, 0] / length) / 0.85, 0, 1)  # 1 at the heel, 0 at the toes
    rings = []
    for level in levels:
        top = 0.045 + 0.04 * heel
        shrink_y, shrink_x = (
            1 - 0.55 * level**2 * (1 - 0.35 * heel),
            1 - 0.5 * level**2 * (foot[:, 0] > 0) - 0.12 * level,
        )
        rings.append(
            np.column_stack(
                [foot[:, 0] * shrink_x - 0.02 * level, foot[:, 1] * shrink_y, 0.018 + top * level]
            )
        )
    body = _skinned(np.array(rings))
    hole = blob((0.09, 0.048, 0.02), 14, 5)
    parts = [(extrude(foot * [1.03, 1.06], 0.022, 0.003), sole), (body, leather)]
    parts.append((moved(hole, (-0.062, 0, 0.088)), dark(rng)))
    lace = plain("cloth", rng, [0.75, 0.74, 0.7] if rng.uniform() < 0.5 else [0.04, 0.04, 0.04])
    for k in range(4):
        x = 0.004 + 0.017 * k
        z = 0.085 - 0.0075 * k - 0.002 * k * (k > 1)
        arc = np.stack(
            [np.full(5, x), np.linspace(-0.022, 0.022, 5), z - 0.006 * np.linspace(-1, 1, 5) ** 2], 1
        )
        parts.append((tube(arc, 0.0025, 5, up=(1, 0, 0)), lace))
    return prop("shoe", *parts)


def _skinned(rings: np.ndarray) -> Mesh:
    """A closed body through rings (R, N, 3) from below upward, flat at both ends."""
    count, n = rings.shape[:2]
    k = np.arange(n)
    faces = []
    for r in range(count - 1):
        a, b = r * n + k, r * n + (k + 1) % n
        faces += [np.stack([a, b, b + n], 1), np.stack([a, b + n, a + n], 1)]
    points = rings.reshape(-1, 3)
    ends = np.stack([rings[0].mean(0), rings[-1].mean(0)])
    low, high = len(points), len(points) + 1
    faces.append(np.stack([(k + 1) % n, k, np.full(n, low)], 1))
    faces.append(np.stack([(count - 1) * n + k, (count - 1) * n + (k + 1) % n, np.full(n, high)], 1))
    points = np.concatenate([points, ends])
    uv = (points[:, :2] - points[:, :2].min(0)) / np.ptp(points[:, :2], axis=0)
    return Mesh(points.astype(np.float32), np.concatenate(faces).astype(np.int32), uv.astype(np.float32))


@family("reading", "bedside", "floor")
def teddy(rng: np.random.Generator) -> Prop:
    """A sitting teddy bear."""
    size = rng.uniform(0.75, 1.15)
    fur = shade(
        np.array(
            [[0.42, 0.25, 0.11], [0.60, 0.44, 0.26], [0.72, 0.68, 0.60], [0.18, 0.09, 0.05], [0.5, 0.32, 0.3]]
        )[rng.integers(5)],
        rng,
    )
    coat, pale = (material("cloth", rng, "speckle", tint, 32) for tint in (fur, np.minimum(1.4 * fur, 0.85)))
    black = dark(rng)
    parts = []
    for where, dims, stuff in (
        ((0, 0, 0), (0.1, 0.085, 0.11), coat),
        ((0, -0.008, 0.095), (0.085, 0.078, 0.078), coat),
        ((0, -0.042, 0.107), (0.04, 0.03, 0.03), pale),
        ((0, -0.056, 0.122), (0.014, 0.01, 0.009), black),
    ):
        parts.append((moved(blob(dims, 14, 8), where), stuff))
    for side in (-1, 1):
        for (x, y, z), dims, stuff in (
            ((0.033, 0, 0.158), (0.03, 0.014, 0.03), coat),
            ((0.017, -0.042, 0.14), (0.008, 0.007, 0.008), black),
            ((0.055, -0.06, 0), (0.042, 0.09, 0.042), coat),
            ((0.055, -0.1, 0.004), (0.036, 0.012, 0.036), pale),
            ((0.055, -0.02, 0.035), (0.034, 0.05, 0.065), coat),
        ):
            parts.append((moved(blob(dims, 8, 6), (side * x, y, z)), stuff))
    if rng.uniform() < 0.5:
        scarf = revolve([[0.02, 0.0], [0.037, 0.002], [0.037, 0.014], [0.02, 0.016], [0.02, 0.0]], 16)
        parts.append((moved(scarf, (0, 0, 0.092)), plain("cloth", rng)))
    return prop("teddy", *[(scaled(mesh, size), m) for mesh, m in parts])


@family("reading", "floor")
def wool(rng: np.random.Generator) -> Prop:
    """A ball of wool, with its end and perhaps two needles."""
    radius = rng.uniform(0.032, 0.05)
    yarn = material("cloth", rng, "wood", accent(rng), 64)
    parts = [(moved(blob((2 * radius, 2 * radius, 1.9 * radius), 16, 9), turn=rng.uniform(0, 6)), yarn)]
    t = np.linspace(0, 2 * np.pi, 18, endpoint=False)
    for _ in range(5):
        axis = rng.normal(size=3)
        axis /= np.linalg.norm(axis)
        first = np.cross(axis, [0.3, 0.5, 0.8])
        first /= np.linalg.norm(first)
        second = np.cross(axis, first)
        ring = radius * 0.985 * (np.cos(t)[:, None] * first + np.sin(t)[:, None] * second) * [1, 1, 0.95]
        parts.append((hoop(ring + [0, 0, 0.95 * radius + 0.001], 0.002, 4, up=axis), yarn))
    end = smooth(
        [
            [radius * 0.5, -0.6 * radius, 0.002],
            [1.3 * radius, -radius, 0.002],
            [1.5 * radius, -0.2 * radius, 0.002],
            [2.2 * radius, -0.5 * radius, 0.002],
        ],
        12,
    )
    parts.append((tube(end, 0.0018, 5), yarn))
    if rng.uniform() < 0.5:
        for turn in (0.5, 2.4):
            way = np.array([np.cos(turn), np.sin(turn), 0.55])
            middle = np.array([0, 0, 1.1 * radius])
            parts.append((tube([middle - 0.06 * way, middle + 0.11 * way], 0.0025, 6), timber(rng, 16)))
    return prop("wool", *parts)


@family("reading", "floor")
def cushion(rng: np.random.Generator) -> Prop:
    """A small cushion, lying, or a folded blanket."""
    width, depth, height = rng.uniform([0.18, 0.14, 0.05], [0.29, 0.24, 0.09])
    fabric = _fabric(rng, 96)
    if rng.uniform() < 0.4:
        layers = [
            (
                moved(box((width, depth, height / 3), 0.008), (*rng.normal(0, 0.003, 2), k * height / 3)),
                fabric,
            )
            for k in range(3)
        ]
        return prop("cushion", *layers)
    s, t = np.meshgrid(np.linspace(-1, 1, 15), np.linspace(-1, 1, 15))
    puff = np.sqrt(np.maximum((1 - s**4) * (1 - t**4), 0.0))
    pinch_x, pinch_y = 1 - 0.06 * (1 - t**2) * s**2, 1 - 0.06 * (1 - s**2) * t**2
    low = 0.25 * height * (1 - puff)
    mesh = relief(s * width / 2 * pinch_x, t * depth / 2 * pinch_y, low + 0.003 + 0.95 * height * puff, low)
    return prop("cushion", (mesh, fabric))
