"""How dim it is in the corners of a room: light that a room's own surfaces keep from each other."""

from __future__ import annotations

import functools

import numpy as np

from vig_world.renderers.raster.native import workspace
from vig_world.renderers.raster.points import strewn
from vig_world.renderers.raster.records import GRID, SWEEP, address
from vig_world.renderers.raster.sweeping import LANES, MARGIN

CELL = 0.12
"""Metres; more where a room would need more than MOST_CELLS along a side."""
MOST_CELLS = 72
REACH = 0.5
"""Metres of height over which what is in the way stops to matter: rooms are closed, and yet light."""

_RINGS = ((90.0, 1), (60.0, 5), (32.0, 6))
"""Elevations in degrees, and how many directions are spread evenly over each."""


@functools.cache
def directions() -> np.ndarray:
    """Unit vectors (K, 3) spread over the upper half of the sphere."""
    rows = []
    for ring, (elevation, count) in enumerate(_RINGS):
        rise = np.radians(elevation)
        turn = 2 * np.pi * (np.arange(count) + 0.5 * (ring % 2)) / count
        rows.append(
            np.stack([np.cos(rise) * np.cos(turn), np.cos(rise) * np.sin(turn), 0 * turn + np.sin(rise)], 1)
        )
    return np.concatenate(rows)


def run_sweep(record: np.ndarray, weights: np.ndarray, towards: np.ndarray, size: tuple[int, ...]) -> None:
    """Sweep the shadows of a SWEEP record (1,) whose grid and occupancy are set.

    weights: (K, 4) irradiance lost to each direction. towards: (K, 3) unit vectors towards the light, upward.
    """
    x, y, _ = size
    slopes = np.ascontiguousarray((towards[:, :2] / towards[:, 2:]).astype(np.float32))
    weights = np.ascontiguousarray(weights.astype(np.float32))
    plane = (x + 2 * MARGIN) * (y + 2 * MARGIN)
    record["planes"] = address(workspace.buffer("planes", 2 * len(weights) * plane, np.float32))
    record["gathered"] = address(workspace.buffer("gathered", 4 * x * y, np.float32))
    record["directions"], record["weights"] = address(slopes), address(weights)
    record["direction_count"] = len(weights)
    record["grid"]["scale"] = np.abs(weights).sum(0).max() / 32000 + 1e-12
    workspace.launch("sweep", "sweep")


def gloom_of(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """What the surfaces of a room, (V, 3) and (F, 3), take from each other of an even light of radiance 1.

    A GRID and its values, as bytes; lost irradiance, of 1.
    """
    low, high = vertices.min(0), vertices.max(0)
    cell = max(CELL, float((high - low).max()) / MOST_CELLS)
    points = strewn(vertices, faces, cell**2 / 3)
    origin = low.astype(np.float64) - 1.5 * cell
    x, y, z = (np.ceil((high - origin) / cell).astype(int) + 3).tolist()
    x = -(-x // LANES) * LANES
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
        run_sweep(record, weights, towards, size)
        lost += values[::side] * grid["scale"]
    result = np.zeros(1, GRID)
    result[0] = grid[0]
    result["scale"] = np.abs(lost).max() / 32000 + 1e-12
    stored = (lost / result["scale"]).astype(np.int16)
    return np.concatenate([result.view(np.uint8), stored.reshape(-1).view(np.uint8)])
