"""Things that carry or reach into a picture: an arm, a twig, the end of a shelf board.

All start at their own origin and go along +X, out of the frame.
"""

from collections.abc import Callable

import numpy as np

from vig_world.assets.materials import material
from vig_world.assets.shapes import box, move_mesh, scale_mesh, smooth, tube
from vig_world.assets.textures import near
from vig_world.assets.things import Prop
from vig_world.mesh import Mesh

_SKINS = np.array(
    [[0.70, 0.45, 0.33], [0.52, 0.30, 0.20], [0.30, 0.15, 0.09], [0.12, 0.06, 0.04]], np.float32
)


def _smooth_tube(points: list[list[float]], count: int, sides: int) -> Mesh:
    """Return a smooth tube through stations (x, y, z, half width, half height)."""
    curve = smooth(points, count)
    return tube(curve[:, :3], curve[:, 3:], sides)


def arm(rng: np.random.Generator) -> Prop:
    """Return a forearm whose fingertips are at the origin, with a sleeve from the wrist on."""
    size = rng.uniform(0.8, 1.1)
    bend = rng.normal(0, 0.04)
    skin = material("skin", rng, "paint", near(_SKINS[rng.integers(len(_SKINS))], rng), 32)
    fingers = []
    for y, reach in ((-0.027, 0.006), (-0.009, 0.0), (0.009, 0.003), (0.027, 0.014)):
        stations = [
            [reach, y * 0.9, -0.004, 0.005, 0.005],
            [reach + 0.012, y, 0.002, 0.0078, 0.0075],
            [0.045, y, 0.008, 0.009, 0.0085],
            [0.085, y * 0.95, 0.0, 0.01, 0.01],
        ]
        fingers.append((_smooth_tube(stations, 9, 8), skin))
    thumb = [
        [0.03, -0.05, 0.002, 0.006, 0.006],
        [0.045, -0.052, 0.004, 0.01, 0.009],
        [0.085, -0.035, 0.0, 0.013, 0.012],
        [0.12, -0.015, 0.0, 0.014, 0.012],
    ]
    palm = [
        [0.068, 0.0, 0.002, 0.03, 0.01],
        [0.085, 0.0, 0.0, 0.041, 0.0145],
        [0.14, 0.0, 0.0, 0.037, 0.017],
        [0.17, 0.0, 0.0, 0.026, 0.018],
        [0.24, bend * 0.3, 0.0, 0.029, 0.023],
        [0.5, bend * 3, 0.0, 0.038, 0.034],
    ]
    cuff = rng.uniform(0.17, 0.3)
    sleeve = [
        [cuff, bend * 0.3, 0.0, 0.037, 0.033],
        [cuff + 0.05, bend * 0.6, 0.0, 0.042, 0.038],
        [0.55, bend * 3.3, 0.0, 0.056, 0.05],
    ]
    pattern = str(rng.choice(("cloth", "cloth", "stripes", "paint", "speckle")))
    fabric = material("cloth", rng, pattern, None, 128)
    hand = [*fingers, (_smooth_tube(thumb, 9, 8), skin), (_smooth_tube(palm, 16, 12), skin)]
    parts = [*hand, (_smooth_tube(sleeve, 8, 14), fabric)]
    return Prop("arm", tuple((scale_mesh(mesh, size), stuff) for mesh, stuff in parts))


def twig(rng: np.random.Generator) -> Prop:
    """Return a stem with leaves on both sides; the tip at the origin."""
    length, spread = 0.5, rng.uniform(0.02, 0.05)
    x = np.linspace(0, length, 12)
    sway = spread * np.sin(x * rng.uniform(6, 14) + rng.uniform(0, 6))
    stem = tube(np.stack([x, sway - sway[0], 0.3 * sway], 1), np.linspace(0.001, 0.004, 12), 6)
    green = near(np.array([0.10, 0.28, 0.06], np.float32), rng, 0.5)
    leaf_length, leaf_width = rng.uniform(0.04, 0.1), rng.uniform(0.25, 0.5)
    t = np.linspace(0, 1, 5)
    along = np.stack([leaf_length * t, 0 * t, 0.12 * leaf_length * np.sin(np.pi * t)], 1)
    width = leaf_length * leaf_width * np.sin(np.pi * np.clip(t**0.8, 0.02, 0.98)) / 2 + 0.0004
    leaf = tube(along, np.stack([width, np.full(5, 0.0006)], 1), 4)
    parts = [(stem, material("wood", rng, "paint", near(0.7 * green, rng), 16))]
    leaves = [material("leaf", rng, "speckle", near(green, rng, 0.3), 32) for _ in range(3)]
    for number, at in enumerate(np.arange(0.005, length, leaf_length * rng.uniform(0.3, 0.5))):
        root = [at, np.interp(at, x, sway - sway[0]), 0.3 * np.interp(at, x, sway)]
        side = -1 if number % 2 else 1
        turn = np.pi - side * rng.uniform(0.5, 1.3) if at > 0.01 else np.pi
        parts.append((move_mesh(leaf, root, turn, rng.normal(0, 0.4)), leaves[number % 3]))
    return Prop("twig", tuple(parts))


def board(rng: np.random.Generator) -> Prop:
    """Return the end of a shelf board."""
    size = [0.7, rng.uniform(0.05, 0.15), rng.uniform(0.012, 0.03)]
    pattern = str(rng.choice(["wood", "wood", "wood", "paint", "paint", "marble"]))
    plank = move_mesh(box(size, 0.0015), [0.35, 0.0, -size[2] / 2])
    return Prop("board", ((plank, material("wood", rng, pattern, None, 128)),))


HOLDERS: dict[str, Callable[[np.random.Generator], Prop]] = {
    make.__name__: make for make in (arm, twig, board)
}
"""Every fixture by name, by a function of a generator."""
