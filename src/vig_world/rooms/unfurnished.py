"""Rooms without furniture: seamless grounds, as things are photographed on, whose floor rises into a wall
without an edge; and empty halls of any size, for views that no furnished room has space for.
"""

import numpy as np

from vig_world.assets.coats import any_colour
from vig_world.assets.materials import plain
from vig_world.assets.textures import texture
from vig_world.assets.things import Material, Support
from vig_world.mesh import Mesh, face_normals
from vig_world.rooms.layout import Layout
from vig_world.rooms.shell import shell

RADIUS, BEND, WALL, HEIGHT = 3.2, 0.7, 1.9, 3.0
"""Metres on a seamless ground: radius of the floor and of its bend into the wall; heights of the wall and
of the nominal ceiling."""
STANDS = 0.6 * (RADIUS - BEND)  # metres along either axis within which things stand on a seamless ground
SEGMENTS, STEPS = 48, 8
TEXTURED = ("cloth", "paint", "wood", "marble", "terrazzo", "weave", "concrete", "plaster")
"""Kinds of textures of those that are not of one colour."""
EMPTY = "empty"  # the kind of empty halls
HALF, SHORTER, CEILING = 4.0, 0.8, 0.8
"""Half the longer side, metres, of the smallest hall; over that, the least half of the other side and the
height of the ceiling."""
SPACE = 2.2  # metres from the middle of the smallest hall within which the camera and the object have space


def draw_sweep(rng: np.random.Generator) -> Layout:
    """Return a round seamless ground: white, grey, of any colour, or of cloth, wood or stone."""
    kind = rng.random()
    if kind < 0.45:
        image = np.full((1, 1, 3), rng.uniform(0.5, 0.93)) * rng.uniform(0.96, 1.0, 3)
    elif kind < 0.6:
        image = np.full((1, 1, 3), np.exp(rng.uniform(np.log(0.02), np.log(0.5)))) * rng.uniform(0.9, 1.1, 3)
    elif kind < 0.75:
        image = any_colour(rng)[None, None]
    else:
        image = texture(str(rng.choice(TEXTURED)), rng, 128)
    material = Material(np.asarray(image, np.float32), "paper", float(rng.uniform(0.5, 1.0)))
    turn = np.linspace(0, np.pi / 2, STEPS)
    bend = np.stack([RADIUS - BEND + BEND * np.sin(turn), BEND * (1 - np.cos(turn))], 1)
    profile = np.concatenate([[[0.0, 0.0], [1.0, 0.0]], bend, [[RADIUS, WALL]]])
    parts = ((_inside(profile, float(rng.uniform(0.4, 1.5))), material),)
    around = np.linspace(0, 2 * np.pi, SEGMENTS, endpoint=False)
    outline = RADIUS * np.stack([np.cos(around), np.sin(around)], 1)
    support = Support("display", (0.0, 0.0, 0.0), (STANDS, STANDS))
    return Layout("seamless", parts, (support,), outline, HEIGHT, np.zeros((0, 5, 2)))


def _inside(profile: np.ndarray, metres: float) -> Mesh:
    """Return a profile (P, 2) of radius and height turned round +Z, facing inwards and up; uv in repeats."""
    around = np.linspace(0, 2 * np.pi, SEGMENTS + 1)
    x, y = (np.outer(profile[:, 0], f(around)) for f in (np.cos, np.sin))
    z = np.broadcast_to(profile[:, 1:], x.shape)
    length = np.concatenate([[0.0], np.linalg.norm(np.diff(profile, axis=0), axis=1).cumsum()])
    outward = length / np.maximum(profile[:, 0], 1e-9) * (profile[:, 0] > 0)
    uv = np.stack([x * outward[:, None], y * outward[:, None]], -1).reshape(-1, 2) / metres
    row, column = np.meshgrid(np.arange(len(profile) - 1), np.arange(SEGMENTS), indexing="ij")
    a = row * (SEGMENTS + 1) + column
    b, c, d = a + 1, a + SEGMENTS + 1, a + SEGMENTS + 2
    faces = np.stack([a, c, d, a, d, b], -1).reshape(-1, 3)
    points = np.stack([x, y, z], -1).reshape(-1, 3).astype(np.float32)
    area = np.linalg.norm(face_normals(points.astype(np.float64), faces), axis=1)
    return Mesh(points, np.ascontiguousarray(faces[area > 1e-12], np.int32), uv.astype(np.float32))


def draw_hall(rng: np.random.Generator, size: float = 1.0) -> Layout:
    """Return floor, four walls, a ceiling and skirting, `size` times as large as the smallest."""
    sides = HALF * size * rng.permutation([1.0, rng.uniform(SHORTER, 1.0)])
    x, y = sides.tolist()
    outline = np.array([[-x, -y], [x, -y], [x, y], [-x, y]])
    height = CEILING * HALF * size
    paint = plain(np.array([0.8, 0.79, 0.75]) * rng.uniform(0.85, 1.0), "wood", 0.5)
    parts = tuple(shell(rng, outline, height, [], 0.2, paint))
    middle = 0.6  # share of each side of a hall on which things stand
    support = Support("display", (0.0, 0.0, 0.0), (middle * x, middle * y))
    return Layout(EMPTY, parts, (support,), outline, height, np.zeros((0, 5, 2)))
