"""The shadows that the object and props cast, on what they stand on and on each other."""

from __future__ import annotations

import functools

import numpy as np
import torch

from vig.scene.light import COSINE_LOBE, sh_basis
from vig_world.renderers.raster.gloom import directions, run_sweep
from vig_world.renderers.raster.native import workspace
from vig_world.renderers.raster.records import GRID, SWEEP, address

CELL = 0.016
"""Metres."""
SIZE = (80, 80, 21)
"""Cells along x and y, centred at the object, and planes from z = 0 up."""
RISE = (0.010, 0.0006)
"""Plane s is RISE[0] s + RISE[1] s^2 above the ground: 1 cm apart at first, 3 cm at the top, 0.44 m up."""
OPACITY = 1.0
BOUNCE = 0.25
"""Share of what is in the way of the light that comes back from it, or from what lies around."""


def cast_shadows(table: np.ndarray, light: np.ndarray) -> np.ndarray:
    """A GRID record (1,) of the light (9,) that ITEM records take from each other; its values are scratch."""
    x, y, z = SIZE
    record = workspace.record("sweep", SWEEP)
    values = workspace.buffer("shadow", x * y * z * 4, np.int16)
    record["occupancy"] = address(workspace.buffer("occupancy", x * y * z, np.float32))
    record["items"], record["item_count"] = address(table), len(table)
    record["opacity"], record["reach"] = OPACITY, 0
    grid = record["grid"]
    grid["origin"], grid["cell"] = (-CELL * (x - 1) / 2, -CELL * (y - 1) / 2, 0), CELL
    grid["rise"], grid["size"], grid["values"] = RISE, SIZE, address(values)
    workspace.launch("strew", "sweep")
    run_sweep(record, sky_weights(light), directions(), SIZE)
    result = np.zeros(1, GRID)
    result[0] = grid[0]
    return result


def sky_weights(light: np.ndarray) -> np.ndarray:
    """Irradiance (K, 4) lost with the light from each of `directions`: v0 and v, see `sweeping`.

    A direction stands for as much of the upper half of the sphere as every other. All together they make up
    what a surface that faces up gets.
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
