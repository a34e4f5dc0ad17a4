"""Fittings without a model: wall shelves, pictures and rugs, each in its own frame."""

import numpy as np

from vig_world.assets.joinery import Joinery
from vig_world.assets.materials import fitting, loose_fabric, material, paint_finish, plain, slot_material
from vig_world.assets.things import Furniture, Support
from vig_world.rooms.shell import Part, quads

RUG = 0.008  # thickness of a rug, metres


def wall_shelf(rng: np.random.Generator) -> Furniture:
    """Return one or two boards on brackets, on z = 0, centred, its back at +Y."""
    j = Joinery(rng)
    x, y = float(rng.uniform(0.25, 0.6)), float(rng.uniform(0.09, 0.14))
    board = paint_finish(rng) if rng.uniform() < 0.3 else slot_material("wood", rng)
    bracket = fitting(rng)
    supports = []
    levels = [0.14, 0.14 + float(rng.uniform(0.28, 0.36))][: int(rng.integers(1, 3))]
    for number, z in enumerate(levels):
        j.board(board, (-x, -y, z), (x, y, z + 0.022), 0.002)
        clearance = levels[1] - z - 0.022 if number + 1 < len(levels) else float("inf")
        supports.append(Support("display", (0.0, 0.0, z + 0.022), (x - 0.01, y - 0.01), 0.0, clearance, 0.0))
        for at in (-0.7 * x, 0.7 * x):
            j.board(bracket, (at - 0.01, -0.7 * y, z - 0.012), (at + 0.01, y, z))
            j.board(bracket, (at - 0.01, y - 0.01, z - 0.14), (at + 0.01, y, z - 0.012))
    return Furniture("wall_shelf", tuple(j.parts()), tuple(supports))


def picture(rng: np.random.Generator, wide: float, high: float) -> list[Part]:
    """Return a framed picture on a wall at y = 0, centred at the origin."""
    j = Joinery(rng)
    frame, bar = fitting(rng) if rng.uniform() < 0.5 else slot_material("wood", rng), 0.02
    x, z = wide / 2, high / 2
    pattern = "print" if rng.uniform() < 0.6 else str(rng.choice(["marble", "wallpaper", "cloth"]))
    mount = 0.04 if rng.uniform() < 0.6 else 0.0
    if mount:
        j.board(plain((0.8, 0.79, 0.75), "paper", 0.8), (-x, 0.002, -z), (x, 0.008, z))
    a, b = x - bar - mount, z - bar - mount
    corners = [(a, 0.01, -b), (-a, 0.01, -b), (-a, 0.01, b), (a, 0.01, b)]
    sheet = quads([corners], np.array([[(0, 0), (1, 0), (1, 1), (0, 1)]]))
    for s in (-x, x - bar):
        j.board(frame, (s, 0.0, -z), (s + bar, 0.025, z), 0.003)
    for s in (-z, z - bar):
        j.board(frame, (-x + bar, 0.0, s), (x - bar, 0.025, s + bar), 0.003)
    return [*j.parts(), (sheet, material("paper", rng, pattern, size=128))]


def rug(rng: np.random.Generator, half: tuple[float, float]) -> list[Part]:
    """Return a rug on the floor, centred; sometimes with a border."""
    j = Joinery(rng)
    x, y = half
    if rng.uniform() < 0.4:
        j.board(loose_fabric(rng), (-x, -y, 0.0), (x, y, RUG - 0.002))
        x, y = x - 0.08, y - 0.08
    j.board(loose_fabric(rng), (-x, -y, 0.0), (x, y, RUG), 0.002)
    return j.parts()
