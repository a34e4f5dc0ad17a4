"""Shadows and ambient occlusion: how much light surfaces take from each other.

Points are scattered over surfaces; each makes its cell of a grid a little opaque. For each of K directions of
light a plane of shadow is swept down through the grid: the shadow in a plane is that of the plane above,
shifted along the direction and thereby a little blurred, joined with the opacity of the cells between. The
light lost from a direction is kept as the irradiance that a normal loses, in harmonics of degree 0 and 1:
lost(n) = v0 + v . n.
"""

from __future__ import annotations

import functools

import numpy as np
import torch

from vig.scene.light import COSINE_LOBE, sh_basis
from vig_world.raster.native import workspace
from vig_world.raster.records import GRID, SWEEP, SWEEP_LANES, SWEEP_MARGIN, address

SHADOW_CELL = 0.016
"""Metres."""
SHADOW_SIZE = (80, 80, 21)
"""Cells along x and y, centred at the object, and planes from z = 0 up."""
RISE = (0.010, 0.0006)
"""Plane s is RISE[0] s + RISE[1] s^2 above the ground: 1 cm apart at first, 3 cm at the top, 0.44 m up."""
LARGEST = 0.4
"""Metres of an object from its origin that the grid is for."""
OPACITY = 1.0
BOUNCE = 0.25
"""Share of the blocked light that returns by reflection, from the blocker or its surroundings."""

AMBIENT_CELL = 0.12
"""Metres; more where a room would need more than MOST_CELLS along a side."""
MOST_CELLS = 72
REACH = 0.5
"""Metres of height over which a blocker's effect fades to 1 / e: rooms are closed, and yet light."""

_RINGS = ((90.0, 1), (60.0, 5), (32.0, 6))
"""Elevations in degrees, and how many directions are spread evenly over each."""


def cast_shadows(table: np.ndarray, light: np.ndarray, reach: float = 0.0) -> np.ndarray:
    """Compute the shadows that the object and props cast, on supports and on each other.

    Args:
        table: ITEM records (N,).
        light: SH coefficients (9,).
        reach: Metres of the object from its origin along any axis; beyond `LARGEST` the grid grows with it.

    Returns:
        A GRID record (1,) of the lost irradiance; its values lie in the thread's scratch memory.
    """
    x, y, z = SHADOW_SIZE
    record = workspace.record("sweep", SWEEP)
    values = workspace.buffer("shadow", x * y * z * 4, np.int16)
    record["occupancy"] = address(workspace.buffer("occupancy", x * y * z, np.float32))
    record["items"], record["item_count"] = address(table), len(table)
    record["opacity"], record["reach"] = OPACITY, 0
    grid = record["grid"]
    scale = max(1.0, reach / LARGEST)
    cell, rise = SHADOW_CELL * scale, tuple(step * scale for step in RISE)
    grid["origin"] = -cell * (x - 1) / 2, -cell * (y - 1) / 2, 0
    grid["cell"], grid["rise"], grid["size"], grid["values"] = cell, rise, SHADOW_SIZE, address(values)
    workspace.launch("scatter", "sweep")
    _run_sweep(record, sky_weights(light), directions(), SHADOW_SIZE)
    result = np.zeros(1, GRID)
    result[0] = grid[0]
    return result


def ambient_occlusion(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Compute how much irradiance a room's own surfaces block, under uniform light of radiance 1.

    Args:
        vertices: (V, 3) metres.
        faces: (F, 3).

    Returns:
        A GRID record and its values, as bytes.
    """
    low, high = vertices.min(0), vertices.max(0)
    cell = max(AMBIENT_CELL, float((high - low).max()) / MOST_CELLS)
    points = surface_points(vertices, faces, cell**2 / 3)
    origin = low.astype(np.float64) - 1.5 * cell
    x, y, z = (np.ceil((high - origin) / cell).astype(int) + 3).tolist()
    x = -(-x // SWEEP_LANES) * SWEEP_LANES
    size = x, y, z
    record = workspace.record("sweep", SWEEP)
    grid = record["grid"]
    grid["origin"], grid["cell"], grid["rise"], grid["size"] = origin, cell, (cell, 0), size
    # Places along x and y are of cells' centres, and cells lie between planes along z.
    cells = np.floor((points[:, :3] - origin) / cell + [0.5, 0.5, 0.0]).astype(np.int64)
    flat = (cells[:, 2] * y + cells[:, 1]) * x + cells[:, 0]
    occupancy = np.bincount(flat, points[:, 3] / cell**2, minlength=(z - 1) * y * x).astype(np.float32)
    record["reach"] = REACH
    values = np.zeros((z, y, x, 4), np.int16)
    lost = np.zeros((z, y, x, 4), np.float32)
    towards = directions()
    for side in (1, -1):
        light = towards * [1, 1, side]
        weights = np.hstack([np.ones((len(light), 1)), 2 * light]) / (2 * len(light))
        turned = np.ascontiguousarray(occupancy.reshape(z - 1, y, x)[::side])
        record["occupancy"], grid["values"] = address(turned), address(values)
        _run_sweep(record, weights, towards, size)
        lost += values[::side] * grid["scale"]
    result = np.zeros(1, GRID)
    result[0] = grid[0]
    result["scale"], result["values"] = np.abs(lost).max() / 32000 + 1e-12, 0  # the values follow
    stored = (lost / result["scale"]).astype(np.int16)
    return np.concatenate([result.view(np.uint8), stored.reshape(-1).view(np.uint8)])


def surface_points(vertices: np.ndarray, faces: np.ndarray, area: float) -> np.ndarray:
    """Scatter points over a mesh, at least one on each face.

    Args:
        vertices: (V, 3) metres.
        faces: (F, 3).
        area: Square metres that a point stands for at most.

    Returns:
        Positions and areas of the points, (N, 4) float32.
    """
    a, b, c = (vertices[faces[:, i]].astype(np.float64) for i in range(3))
    areas = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
    counts = np.maximum(1, np.ceil(areas / area)).astype(int)
    chosen = np.repeat(np.arange(len(faces)), counts)
    number = np.arange(len(chosen)) - np.repeat(np.cumsum(counts) - counts, counts)
    # A plane sequence of low discrepancy (multiples of the plastic number's powers), folded to a triangle.
    u, v = ((0.5 + number[:, None] * [0.7548776662466927, 0.5698402909980532]) % 1).T
    over = u + v > 1
    u, v = np.where(over, 1 - u, u)[:, None], np.where(over, 1 - v, v)[:, None]
    single = (counts == 1)[chosen, None]
    u, v = np.where(single, 1 / 3, u), np.where(single, 1 / 3, v)
    places = a[chosen] + u * (b - a)[chosen] + v * (c - a)[chosen]
    return np.hstack([places, (areas / counts)[chosen, None]]).astype(np.float32)


@functools.cache
def directions() -> np.ndarray:
    """Unit vectors (K, 3) spread over the upper hemisphere."""
    rows = []
    for ring, (elevation, count) in enumerate(_RINGS):
        rise = np.radians(elevation)
        turn = 2 * np.pi * (np.arange(count) + 0.5 * (ring % 2)) / count
        rows.append(
            np.stack([np.cos(rise) * np.cos(turn), np.cos(rise) * np.sin(turn), 0 * turn + np.sin(rise)], 1)
        )
    return np.concatenate(rows)


def sky_weights(light: np.ndarray) -> np.ndarray:
    """Irradiance (K, 4) lost with the light from each of `directions`: v0 and v, see the module's docstring.

    Each direction stands for the same share of the upper hemisphere. All together they make up the irradiance
    of a surface that faces up.
    """
    basis, weights = _basis()
    weights = weights * np.maximum(basis[:-1] @ light, 0.0)[:, None]
    whole = max(float(basis[-1] @ (light * COSINE_LOBE)), 0.0)
    reached = float((weights[:, 0] + weights[:, 3]).sum())
    return weights * ((1 - BOUNCE) * whole / max(reached, 1e-9))


@functools.cache
def _basis() -> tuple[np.ndarray, np.ndarray]:
    """SH (K + 1, 9) of the directions and of straight up; weights (K, 4) of a radiance of 1 from each."""
    towards = directions()
    basis = sh_basis(torch.from_numpy(np.concatenate([towards, [[0.0, 0.0, 1.0]]]))).numpy()
    # A_l Y_l(d) Y_l(n) of degrees 0 and 1: 1 / (4 pi) and d . n / (2 pi), of a solid angle of 2 pi / K.
    return basis, np.hstack([np.full((len(towards), 1), 0.5), towards]) / len(towards)


def _run_sweep(record: np.ndarray, weights: np.ndarray, towards: np.ndarray, size: tuple[int, ...]) -> None:
    """Sweep the shadows of a SWEEP record (1,) whose grid and occupancy are set.

    weights: (K, 4) irradiance lost to each direction. towards: (K, 3) unit vectors towards the light, upward.
    """
    x, y, _ = size
    slopes = np.ascontiguousarray((towards[:, :2] / towards[:, 2:]).astype(np.float32))
    weights = np.ascontiguousarray(weights.astype(np.float32))
    plane = (x + 2 * SWEEP_MARGIN) * (y + 2 * SWEEP_MARGIN)
    record["planes"] = address(workspace.buffer("planes", 2 * len(weights) * plane, np.float32))
    record["gathered"] = address(workspace.buffer("gathered", 4 * x * y, np.float32))
    record["directions"], record["weights"] = address(slopes), address(weights)
    record["direction_count"] = len(weights)
    record["grid"]["scale"] = np.abs(weights).sum(0).max() / 32000 + 1e-12
    workspace.launch("sweep", "sweep")
