"""Doors and windows with their fittings, in their wall's frame (x along, y into the room, z up)."""

import numpy as np

from vig_world.assets.joinery import Joinery, rod, stick
from vig_world.assets.materials import fitting, loose_fabric, paint_finish, plain, slot_material
from vig_world.assets.shapes import relief
from vig_world.assets.textures import noise
from vig_world.assets.things import Material, Support
from vig_world.rooms.shell import Opening, Part, quads

CURTAIN = 0.13  # metres that curtains stand off the wall
NOSE = 0.05  # most metres that a sill juts out
SILL = 0.03  # thickness of a sill, metres


def door(rng: np.random.Generator, opening: Opening, paint: Material) -> list[Part]:
    """Return a closed door in its frame."""
    j = Joinery(rng)
    a, b, high = opening.left, opening.right, opening.high
    leaf = paint if rng.uniform() < 0.6 else slot_material("wood", rng)
    for x in (a - 0.06, b - 0.01):
        j.board(paint, (x, -0.06, 0.0), (x + 0.07, 0.02, high - 0.01), 0.003)
    j.board(paint, (a - 0.06, -0.06, high - 0.01), (b + 0.06, 0.02, high + 0.06), 0.003)
    low, top = (a + 0.01, -0.05, 0.005), (b - 0.01, -0.015, high - 0.01)
    j.board(leaf, low, top)
    kind, middle = rng.integers(3), (a + b) / 2
    if kind < 2:  # raised fillets round panels
        columns = (
            [(a + 0.12, b - 0.12)] if kind == 0 else [(a + 0.12, middle - 0.05), (middle + 0.05, b - 0.12)]
        )
        for x0, x1 in columns:
            for z0, z1 in ((0.2, 0.85), (1.05, high - 0.14)):
                for s, e in ((x0, x0 + 0.03), (x1 - 0.03, x1)):
                    j.board(leaf, (s, -0.015, z0), (e, -0.004, z1))
                for s, e in ((z0, z0 + 0.03), (z1 - 0.03, z1)):
                    j.board(leaf, (x0 + 0.03, -0.015, s), (x1 - 0.03, -0.004, e))
    metal = fitting(rng)
    x, way = (b - 0.07, -1) if rng.uniform() < 0.5 else (a + 0.07, 1)
    j.board(metal, (x - 0.02, -0.015, 0.94), (x + 0.02, -0.009, 1.12), 0.002)
    j.add(
        metal,
        rod(
            [[x, -0.012, 1.05], [x, 0.035, 1.05], [x + 0.03 * way, 0.04, 1.05], [x + 0.12 * way, 0.04, 1.05]],
            0.009,
            6,
        ),
    )
    return j.parts()


def _outside(rng: np.random.Generator) -> Material:
    """Return the view out of a window, out of focus: sky above, trees or houses below."""
    size = 48
    v = np.linspace(1, 0, size)[:, None]
    u = np.linspace(0, 1, size, endpoint=False)[None]
    sky = np.array([0.75, 0.86, 1.0]) * (1 - v[..., None]) + np.array([0.5, 0.7, 1.0]) * v[..., None]
    if rng.uniform() < 0.5:
        sky = np.full(3, 0.92) * (0.9 + 0.1 * v[..., None])
    phases = rng.uniform(0, 2 * np.pi, 4)
    skyline = rng.uniform(0.15, 0.5) + sum(
        0.06 / k * np.sin(2 * np.pi * k * u + p) for k, p in enumerate(phases, 1)
    )
    ground = np.array([0.16, 0.26, 0.1]) if rng.uniform() < 0.65 else np.array([0.4, 0.34, 0.3])
    leaves = 1 + 0.3 * noise(rng, size, 1.2)
    weight = 1 / (1 + np.exp(-(v - skyline) * 14))
    image = sky * weight[..., None] + ground * leaves[..., None] * (1 - weight[..., None])
    emission = float(rng.uniform(1.0, 2.2))
    return Material(np.clip(image, 0.02, 0.95).astype(np.float32), "glass", 0.1, "", emission)


def window(
    rng: np.random.Generator, opening: Opening, depth: float, paint: Material, curtained: bool
) -> tuple[list[Part], Support]:
    """Return a window in a recess `depth` deep, with sill, blinds and curtains, and its sill as a support."""
    j = Joinery(rng)
    a, b, low, high = opening.left, opening.right, opening.low, opening.high
    y, bar = 0.045 - depth, 0.05
    for x in (a, b - bar):
        j.board(paint, (x, -depth, low), (x + bar, y, high), 0.004)
    for z in (low, high - bar):
        j.board(paint, (a + bar, -depth, z), (b - bar, y, z + bar), 0.004)
    lights = max(1, round((b - a) / rng.uniform(0.5, 0.9)))
    for x in np.linspace(a, b, lights + 1)[1:-1].tolist():
        j.board(paint, (x - 0.03, -depth, low + bar), (x + 0.03, y - 0.002, high - bar), 0.004)
    if rng.uniform() < 0.4:
        rail = low + float(rng.choice([0.5, 0.72])) * (high - low)
        j.board(paint, (a + bar, -depth, rail - 0.02), (b - bar, y - 0.006, rail + 0.02), 0.003)
    stuff = paint if rng.uniform() < 0.6 else slot_material("top", rng)
    nose = float(rng.uniform(0.02, NOSE))
    j.board(stuff, (a - 0.004, y - 0.01, low - SILL), (b + 0.004, nose, low), 0.003)  # its ends in the wall
    clear = high - low
    if rng.uniform() < 0.5:
        clear = _blind(j, opening, y, float(rng.uniform(0.08, 0.55)) * clear)
    if curtained:
        _curtains(j, opening)
    pane = quads(
        [[(b, 0.01 - depth, low), (a, 0.01 - depth, low), (a, 0.01 - depth, high), (b, 0.01 - depth, high)]],
        np.array([[(1, 0), (0, 0), (0, 1), (1, 1)]]),
    )
    near, far = -0.001, y + 0.01
    centre = ((a + b) / 2, (near + far) / 2, low)
    half = ((b - a) / 2 - 0.02, (near - far) / 2)
    sill = Support("display", centre, half, np.pi, clear - 0.005, 0.01)
    return [*j.parts(), (pane, _outside(rng))], sill


def _blind(j: Joinery, opening: Opening, y: float, drop: float) -> float:
    """Hang slats, or a roller's cloth, let down by `drop` metres; return the clear height below."""
    a, b, high = opening.left + 0.015, opening.right - 0.015, opening.high
    rng = j.rng
    if rng.uniform() < 0.6:
        white = paint_finish(rng) if rng.uniform() < 0.4 else plain((0.8, 0.8, 0.78))
        j.board(white, (a, y + 0.01, high - 0.03), (b, y + 0.05, high))
        for z in np.arange(high - 0.045, high - drop, -0.03).tolist():
            j.board(white, (a, y + 0.012, z - 0.012), (b, y + 0.016, z + 0.01))
        j.board(white, (a, y + 0.008, high - drop - 0.02), (b, y + 0.024, high - drop))
    else:
        cloth = loose_fabric(rng)
        j.board(cloth, (a, y + 0.014, high - drop), (b, y + 0.017, high))
        j.board(cloth, (a, y + 0.005, high - 0.05), (b, y + 0.045, high), 0.01)
        j.board(plain((0.7, 0.7, 0.68)), (a, y + 0.01, high - drop - 0.02), (b, y + 0.022, high - drop))
    return high - drop - 0.02 - opening.low


def _curtains(j: Joinery, opening: Opening) -> None:
    """Add a curtain on each side, drawn back, on a rod."""
    rng = j.rng
    cloth, metal = loose_fabric(rng), fitting(rng)
    top = opening.high + 0.1
    low = 0.02 if rng.uniform() < 0.6 else max(0.02, opening.low - 0.12)
    wide, over = float(rng.uniform(0.18, 0.3)), 0.06
    for left in (opening.left + over - wide, opening.right - over):
        folds = int(rng.integers(3, 6))
        x = np.linspace(0, wide, 4 * folds + 1)
        wave = 0.022 * np.sin(2 * np.pi * folds * x / wide + rng.uniform(0, 6))
        gather = np.array([[1.0], [0.9]])
        grid_x = wide / 2 + (x - wide / 2)[None] * gather[::-1]
        grid_y = np.broadcast_to(np.array([[low], [top]]), grid_x.shape)
        sheet = np.broadcast_to(wave, grid_x.shape)
        j.add(cloth, relief(grid_x, grid_y, sheet + 0.004, sheet - 0.004), (left, 0.09, 0), tilt=np.pi / 2)
    a, b = opening.left - wide, opening.right + wide
    j.add(metal, stick([a, 0.09, top + 0.01], [b, 0.09, top + 0.01], 0.012, 8))
    for at in (a + 0.03, b - 0.03):
        j.board(metal, (at - 0.008, 0.0, top), (at + 0.008, 0.09, top + 0.016))


def reach(opening: Opening, curtained: bool) -> tuple[float, float]:
    """Return how far along the wall a window with its curtains goes."""
    aside = 0.3 if curtained else 0.05
    return opening.left - aside, opening.right + aside
