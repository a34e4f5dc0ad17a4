"""Props of paper, card, cloth and wood: book, book stack, box, carton, frame, napkin, cloth, blocks."""

from __future__ import annotations

import numpy as np

from vig_world.assets.props.families import family
from vig_world.assets.props.material import Material, Prop, label, material, prop
from vig_world.assets.props.shapes import box, moved, relief
from vig_world.assets.textures import colour, noise, shade
from vig_world.mesh import Mesh

_MOUNT = (0.78, 0.76, 0.70)


def _book(
    rng: np.random.Generator, width: float, depth: float, thickness: float
) -> list[tuple[Mesh, Material]]:
    """A closed book lying on z = 0, its spine on the -X side."""
    cover = label(rng, 96) if rng.uniform() < 0.7 else material("cloth", rng, "cloth")
    board, lip = 0.003, 0.004
    lines = np.tile(shade([0.78, 0.74, 0.64], rng), (32, 4, 1))
    lines *= rng.uniform(0.8, 1.1, (32, 1, 1)).astype(np.float32)
    pages = Material(np.clip(lines, 0.02, 0.95), "paper", 0.9)
    block = box((width - 2 * lip, depth - 2 * lip, thickness - 1.6 * board))
    lid = box((width, depth, board), 0.0008)
    spine = box((board, depth, thickness), 0.0008)
    return [
        (moved(block, (0, 0, 0.8 * board)), pages),
        (lid, cover),
        (moved(lid, (0, 0, thickness - board)), cover),
        (moved(spine, (-width / 2, 0, 0)), cover),
    ]


def _book_size(rng: np.random.Generator) -> tuple[float, float, float]:
    width = rng.uniform(0.1, 0.19)
    return width, width * rng.uniform(1.25, 1.55), rng.uniform(0.01, 0.05)


@family("desk", "reading", "display", "storage", "bedside")
def book(rng: np.random.Generator) -> Prop:
    """A book, lying or standing upright."""
    size = _book_size(rng)
    parts = _book(rng, *size)
    if rng.uniform() < 0.5:
        parts = [(moved(mesh, tilt=np.pi / 2), m) for mesh, m in parts]
    return prop("book", *parts)


@family("desk", "reading", "display", "storage", "bedside", "floor")
def book_stack(rng: np.random.Generator) -> Prop:
    """Two to four books on each other, the larger ones below."""
    sizes = sorted((_book_size(rng) for _ in range(rng.integers(2, 5))), reverse=True)
    parts, height = [], 0.0
    for size in sizes:
        turn = rng.normal(0, 0.15) + np.pi * rng.integers(2)
        offset = (*rng.normal(0, 0.006, 2), height)
        parts += [(moved(mesh, offset, turn), m) for mesh, m in _book(rng, *size)]
        height += size[2]
    return prop("book_stack", *parts)


@family("cooking", "storage")
def printed_box(rng: np.random.Generator) -> Prop:
    """A cardboard packet of food, tea or medicine, standing or lying."""
    size = np.sort(rng.uniform([0.025, 0.06, 0.08], [0.07, 0.16, 0.26]))
    lying = rng.uniform() < 0.35
    size = size[[2, 1, 0]] if lying else size[[1, 0, 2]]
    return prop("printed_box", (box(size, 0.001), label(rng)))


@family("cooking", "drinks", "storage")
def carton(rng: np.random.Generator) -> Prop:
    """A milk carton with a gabled top."""
    side, height = rng.uniform(0.06, 0.09), rng.uniform(0.12, 0.22)
    depth = side * rng.uniform(0.8, 1.0)
    gable = depth * rng.uniform(0.4, 0.55)
    fin = 0.015
    skin = label(rng)
    t = np.linspace(-1, 1, 9)
    grid_x, grid_y = np.meshgrid([-side / 2, side / 2], t * depth / 2)
    roof = np.maximum(gable * (1 - np.abs(grid_y) / (depth / 2)), 0.0) + height
    parts = [
        (box((side, depth, height), 0.001), skin),
        (relief(grid_x, grid_y, roof + 1e-4, height - 0.001), skin),
        (moved(box((side, 0.004, fin + 0.004), 0.0005), (0, 0, height + gable - 0.004)), skin),
    ]
    return prop("carton", *parts)


@family("desk", "reading", "display", "bedside")
def frame(rng: np.random.Generator) -> Prop:
    """A standing picture frame that leans back a little."""
    width, height = rng.uniform(0.09, 0.2), rng.uniform(0.12, 0.26)
    border, depth = rng.uniform(0.01, 0.025), rng.uniform(0.008, 0.016)
    wood = material("wood", rng, "wood") if rng.uniform() < 0.6 else material("plastic", rng)
    parts = []
    for sign in (-1, 1):
        rail = box((width, depth, border), 0.0015)
        post = box((border, depth, height - 2 * border), 0.0015)
        parts.append((moved(rail, (0, 0, (height - border) * (sign > 0))), wood))
        parts.append((moved(post, (sign * (width - border) / 2, 0, border)), wood))
    picture = box((width - 1.5 * border, 0.4 * depth, height - 1.5 * border))
    parts.append(
        (
            moved(picture, (0, 0, 0.75 * border)),
            material("paper", rng, "picture", _MOUNT if rng.uniform() < 0.5 else None, 96),
        )
    )
    lean = rng.uniform(0.1, 0.3)
    parts = [(moved(mesh, tilt=-lean), m) for mesh, m in parts]
    top = height * np.array([np.sin(lean), np.cos(lean)])
    strut = box((0.35 * width, 0.003, 0.72 * height))
    parts.append((moved(strut, (0, 1.45 * top[0], 0), tilt=0.8 * lean), wood))
    return prop("frame", *parts)


@family("dining", "drinks", "washing")
def napkin(rng: np.random.Generator) -> Prop:
    """A folded napkin or towel: a few soft layers."""
    width, depth = rng.uniform(0.09, 0.2), rng.uniform(0.09, 0.16)
    layers = int(rng.integers(2, 4))
    thickness = rng.uniform(0.003, 0.014)
    fabric = material("cloth", rng, "cloth", size=128)
    s, t = np.meshgrid(np.linspace(-1, 1, 11), np.linspace(-1, 1, 8))
    parts, bottom = [], np.zeros_like(s)
    for i in range(layers):
        shrink = 1 - 0.02 * i - rng.uniform(0, 0.03)
        edge = np.maximum(np.abs(s), np.abs(t)) ** 6
        wave = 0.25 * np.sin(rng.uniform(1, 3) * s + rng.uniform(0, 6)) * np.cos(rng.uniform(1, 3) * t)
        top = bottom + thickness * (0.95 - 0.35 * edge + wave * (i > 0) * (1 - edge))
        bulge = 1 + 0.015 * np.cos(3 * t + i)
        parts.append((relief(s * bulge * shrink * width / 2, t * shrink * depth / 2, top, bottom), fabric))
        bottom = np.maximum(bottom, top - 0.1 * thickness)
    return prop("napkin", *parts)


@family("washing", "floor")
def crumpled_cloth(rng: np.random.Generator) -> Prop:
    """A cloth dropped in a heap."""
    n = 18
    s, t = np.meshgrid(np.linspace(-1, 1, n), np.linspace(-1, 1, n))
    radius = rng.uniform(0.06, 0.13)
    bend = noise(rng, 2 * n, 2.0)[:n, :n]
    along = rng.uniform(0, 2 * np.pi)
    phase = rng.uniform(6, 11) * (np.cos(along) * s + np.sin(along) * t) + 1.6 * bend
    folds = (0.5 + 0.5 * np.sin(phase)) ** 2 + 0.3 * np.abs(noise(rng, 2 * n, 1.8)[n:, n:])
    rim = np.clip(1.05 - np.maximum(np.abs(s), np.abs(t)) ** 4, 0.06, 1)
    top = rng.uniform(0.045, 0.085) * rim * (0.08 + np.exp(-(s**2 + t**2)) * (0.2 + 0.6 * folds))
    drift = 0.12 * radius * noise(rng, 2 * n, 2.2)[:n, :n]
    squeeze = 1 - 0.18 * np.minimum(np.abs(s), np.abs(t)) ** 2  # draws the corners in
    mesh = relief(radius * s * squeeze + drift, radius * t * squeeze + drift.T, top)
    return prop("crumpled_cloth", (mesh, material("cloth", rng, "cloth", size=128)))


@family("floor")
def toy_blocks(rng: np.random.Generator) -> Prop:
    """One to five wooden toy blocks, side by side and piled up."""
    side = rng.uniform(0.03, 0.05)
    parts = []
    count = int(rng.integers(1, 6))
    for i in range(count):
        level, place = (i // 2, i % 2) if count > 2 else (i, 0)
        pattern = str(rng.choice(["paint", "wood", "print"]))
        paint = material("wood", rng, pattern, None if pattern == "wood" else colour(rng), 64)
        offset = (
            (place - 0.5 * (count > 2)) * 1.5 * side + rng.normal(0, 0.002),
            rng.normal(0, 0.002),
            level * side,
        )
        parts.append((moved(box((side, side, side), 0.08 * side), offset, rng.normal(0, 0.12)), paint))
    return prop("toy_blocks", *parts)
