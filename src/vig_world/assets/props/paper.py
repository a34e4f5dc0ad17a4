"""Props of the desk made of paper, and what one writes with: sheets, newspaper, magazine, notebook, tape."""

from __future__ import annotations

import numpy as np

from vig_world.assets.props.families import family
from vig_world.assets.props.material import (
    Material,
    Prop,
    dark,
    label,
    material,
    metal,
    plain,
    plastic,
    prop,
    timber,
)
from vig_world.assets.props.shapes import box, extrude, moved, relief, revolve, rounded, tube
from vig_world.assets.textures import near, noise, shade, texture
from vig_world.mesh import Mesh

_PAPER = np.array([0.80, 0.79, 0.76], np.float32)


def _sheet(
    rng: np.random.Generator,
    width: float,
    depth: float,
    thick: float,
    curl: float,
    grid: tuple[int, int] = (6, 8),
) -> Mesh:
    """A leaf or a thin stack of paper on z = 0 whose corners rise by up to `curl`."""
    s, t = np.meshgrid(np.linspace(-1, 1, grid[0]), np.linspace(-1, 1, grid[1]))
    corner = rng.uniform(-1, 1, 2)
    rise = curl * np.maximum(s * corner[0] + t * corner[1] - 0.3, 0) ** 2
    return relief(s * width / 2, t * depth / 2, rise + thick, rise)


@family("desk")
def paper_sheets(rng: np.random.Generator) -> Prop:
    """One to five sheets, letters or bills, scattered over each other."""
    width, depth = (0.21, 0.297) if rng.uniform() < 0.4 else rng.uniform([0.1, 0.14], [0.15, 0.21])
    parts = []
    for k in range(rng.integers(1, 6)):
        face = material(
            "paper", rng, "page" if rng.uniform() < 0.7 else "paint", shade(_PAPER, rng, 0.05), 96
        )
        sheet = _sheet(rng, width, depth, 0.0006, 0.012)
        parts.append((moved(sheet, (*rng.normal(0, 0.008, 2), 0.0008 * k), rng.normal(0, 0.12)), face))
    return prop("paper_sheets", *parts)


@family("dining", "reading", "floor")
def newspaper(rng: np.random.Generator) -> Prop:
    """A folded newspaper."""
    width, depth = rng.uniform(0.2, 0.28), rng.uniform(0.17, 0.22)
    news = material("paper", rng, "news", None, 128)
    parts, z = [], 0.0
    for _ in range(2):
        thick = rng.uniform(0.002, 0.004)
        s, t = np.meshgrid(np.linspace(-1, 1, 8), np.linspace(-1, 1, 8))
        top = (
            thick
            * (1 + 0.5 * np.cos(1.5 * t + rng.uniform(-1, 1)) * (1 - s**2))
            * np.sqrt(1.05 - np.minimum(t, 0) ** 8)
        )
        parts.append(
            (moved(relief(s * width / 2, t * depth / 2, top, 0.0), (*rng.normal(0, 0.002, 2), z)), news)
        )
        z += 0.75 * thick
    return prop("newspaper", *parts)


@family("desk", "reading", "floor")
def magazine(rng: np.random.Generator) -> Prop:
    """A magazine or brochure, or a pile of up to four."""
    width, depth = rng.uniform(0.15, 0.21), rng.uniform(0.21, 0.28)
    parts, z = [], 0.0
    for _ in range(rng.integers(1, 5)):
        thick = rng.uniform(0.003, 0.008)
        cover = label(rng, 96)
        mesh = _sheet(rng, width, depth, thick, 0.006 if z == 0 else 0.0)
        parts.append((moved(mesh, (*rng.normal(0, 0.004, 2), z), rng.normal(0, 0.1)), cover))
        z += thick + 0.0005
    return prop("magazine", *parts)


@family("desk", "reading")
def open_book(rng: np.random.Generator) -> Prop:
    """An open book or notebook, lying."""
    width, depth, thick = rng.uniform(0.1, 0.14), rng.uniform(0.15, 0.21), rng.uniform(0.008, 0.02)
    paper = shade(_PAPER * [1, 0.97, 0.9], rng, 0.06)
    s, t = np.meshgrid(np.linspace(0, 1, 9), np.linspace(-1, 1, 4))
    top = 0.002 + thick * (1 - 0.75 * s**2) * np.minimum(1, 6 * s + 0.3)
    right = relief(width * s, depth / 2 * t, top, 0.0018)
    left = relief(-width * s[:, ::-1], depth / 2 * t, top[:, ::-1], 0.0018)
    parts = []
    for leaves in (left, right):
        page = material("paper", rng, "page" if rng.uniform() < 0.85 else "picture", paper, 96)
        parts.append((leaves, page))
    cover = box((2 * width + 0.01, depth + 0.008, 0.002), 0.0005)
    parts.append((cover, plain("cloth", rng)))
    return prop("open_book", *parts)


@family("desk")
def envelope(rng: np.random.Generator) -> Prop:
    """One to four envelopes or postcards, with stamps."""
    parts = []
    for k in range(rng.integers(1, 5)):
        width = rng.uniform(0.14, 0.22)
        depth = width * rng.uniform(0.48, 0.7)
        card = rng.uniform() < 0.3
        tint = shade(
            np.array([[0.8, 0.79, 0.76], [0.52, 0.38, 0.22], [0.75, 0.70, 0.58]])[rng.integers(3)], rng, 0.06
        )
        face = (
            material("paper", rng, "picture", None, 64)
            if card
            else Material(_addressed(rng, tint), "paper", 0.8)
        )
        at = (*rng.normal(0, 0.008, 2), 0.0018 * k)
        parts.append((moved(box((width, depth, 0.0016), 0.0003), at, rng.normal(0, 0.2)), face))
    return prop("envelope", *parts)


def _addressed(rng: np.random.Generator, tint: np.ndarray) -> np.ndarray:
    """The front of an envelope: an address, a stamp, a postmark."""
    image = np.empty((96, 96, 3), np.float32)
    image[:] = tint
    image[48:80, 36:80] = texture("page", rng, 96, tint)[30:62, 10:54]
    image[8:28, 76:90] = texture("picture", rng, 32, [0.8, 0.8, 0.78])[:20, 9:23]
    return image


def _pencil(rng: np.random.Generator, length: float) -> list[tuple[Mesh, Material]]:
    """A pencil or pen along +X, lying on z = 0."""
    wood = rng.uniform() < 0.5
    r = rng.uniform(0.0032, 0.0045)
    paint = plain("wood" if wood else "plastic", rng)
    shaft = tube(np.linspace([0, 0, r], [length, 0, r], 2), r, 6)
    tip = tube(np.linspace([length, 0, r], [length + 0.014, 0, r], 3), np.array([0.98, 0.55, 0.12]) * r, 6)
    end = tube(np.linspace([-0.012, 0, r], [0.001, 0, r], 2), 1.02 * r, 6)
    return [
        (shaft, paint),
        (tip, plain("wood", rng, [0.55, 0.36, 0.2]) if wood else metal(rng)),
        (end, paint if rng.uniform() < 0.5 else metal(rng)),
    ]


@family("desk", "reading")
def notebook(rng: np.random.Generator) -> Prop:
    """A notebook or pad with a pen on it."""
    width, depth, thick = rng.uniform(0.09, 0.17), rng.uniform(0.13, 0.22), rng.uniform(0.006, 0.02)
    cover = material(
        "paper", rng, str(rng.choice(["paint", "leather", "cloth", "print", "floral"])), None, 64
    )
    pages = plain("paper", rng, shade(_PAPER, rng, 0.08))
    outline = rounded(width, depth, 0.006)
    parts = [
        (extrude(outline, 0.0015), cover),
        (moved(extrude(outline * 0.975, thick - 0.003), (0, 0, 0.0015)), pages),
        (moved(extrude(outline, 0.0015, 0.0003), (0, 0, thick - 0.0015)), cover),
    ]
    if rng.uniform() < 0.4:  # a ribbon round it
        parts.append(
            (moved(box((0.006, 1.01 * depth, thick + 0.001)), (0.3 * width, 0, 0)), plain("cloth", rng))
        )
    lie = (-0.04, rng.uniform(-0.03, 0.03), thick)
    if rng.uniform() < 0.75:
        parts += [(moved(mesh, lie, rng.uniform(-0.9, 0.9)), m) for mesh, m in _pencil(rng, 0.12)]
    return prop("notebook", *parts)


@family("desk")
def pencils(rng: np.random.Generator) -> Prop:
    """Two to five pencils, crayons and pens, lying."""
    parts = []
    for k in range(rng.integers(2, 6)):
        turn, at = rng.normal(0, 0.06), (rng.uniform(-0.01, 0.01), 0.019 * k, 0)
        parts += [(moved(mesh, at, turn), m) for mesh, m in _pencil(rng, rng.uniform(0.08, 0.15))]
    return prop("pencils", *parts)


@family("cooking", "storage", "washing", "floor")
def paper_roll(rng: np.random.Generator) -> Prop:
    """A roll of kitchen or toilet paper, standing; perhaps on a holder."""
    radius = rng.uniform(0.05, 0.062)
    height = rng.choice([0.1, rng.uniform(0.2, 0.25)])
    core = 0.02
    loop = [
        [core, 0],
        [radius, 0],
        [radius, 0],
        [radius, height],
        [radius, height],
        [core, height],
        [core, height],
        [core, 0],
    ]
    white = Material((_PAPER * (1 + 0.02 * noise(rng, 32, 0.5)[..., None])).astype(np.float32), "paper", 0.95)
    parts = [(revolve(loop, 28), white)]
    if height > 0.15 and rng.uniform() < 0.6:
        stuff = timber(rng, 32) if rng.uniform() < 0.5 else metal(rng)
        parts = [
            (moved(parts[0][0], (0, 0, 0.012)), white),
            (revolve([[0, 0], [0.07, 0], [0.07, 0], [0.07, 0.012], [0.07, 0.012], [0, 0.012]], 24), stuff),
            (
                revolve(
                    [
                        [0, 0.01],
                        [0.01, 0.01],
                        [0.01, height + 0.03],
                        [0.006, height + 0.036],
                        [0, height + 0.037],
                    ],
                    12,
                ),
                stuff,
            ),
        ]
    return prop("paper_roll", *parts)


@family("desk", "storage")
def tape(rng: np.random.Generator) -> Prop:
    """A roll or two of tape, string or ribbon, lying."""
    parts = []
    for k in range(rng.integers(1, 3)):
        radius, height = rng.uniform(0.03, 0.05), rng.uniform(0.012, 0.045)
        inner = 0.72 * radius
        loop = [
            [inner, 0],
            [radius, 0],
            [radius, 0],
            [radius, height],
            [radius, height],
            [inner, height],
            [inner, height],
            [inner, 0],
        ]
        core = [[p[0] - (0.002 if p[0] == inner else radius - inner), p[1]] for p in loop]
        tint = [[0.58, 0.42, 0.22], [0.78, 0.74, 0.62], None, [0.05, 0.05, 0.05]][rng.integers(4)]
        at = (0.1 * k, 0.01 * k, 0)
        parts.append(
            (moved(revolve(loop, 26), at), plain("plastic", rng, None if tint is None else near(tint, rng)))
        )
        parts.append((moved(revolve(core, 20), at), plain("paper", rng, [0.45, 0.33, 0.2])))
    return prop("tape", *parts)


@family("desk")
def scissors(rng: np.random.Generator) -> Prop:
    """A pair of scissors, half open, lying."""
    shiny, grip = plain("metal", rng, [0.5, 0.5, 0.5]), plastic(rng) if rng.uniform() < 0.6 else dark(rng)
    spread = rng.uniform(0.08, 0.3)
    blade = [[-0.006, -0.02], [0.006, -0.02], [0.008, 0.03], [0.002, 0.1], [-0.003, 0.1], [-0.006, 0.02]]
    turn = np.linspace(0, 2 * np.pi, 14, endpoint=False)
    parts = []
    for side in (-1, 1):
        lift = 0.004 + 0.0012 * (side > 0)
        parts.append((moved(extrude(blade, 0.0018), (0, 0, lift), side * spread), shiny))
        loop = np.column_stack(
            [side * 0.022 + 0.017 * np.cos(turn), -0.055 + 0.028 * np.sin(turn), np.full(14, 0.006)]
        )
        from_loop = tube([[side * 0.012, -0.033, 0.006], [0, -0.01, 0.006]], [0.005, 0.006], 6)
        ring = tube(np.concatenate([loop, loop[:1]]), 0.005, 6)
        parts += [(moved(mesh, (0, 0, 0), -side * spread * 0.2), grip) for mesh in (ring, from_loop)]
    return prop("scissors", *parts)
