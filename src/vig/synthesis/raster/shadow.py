"""The shadows that the object and props cast, on what they stand on and on each other."""

from __future__ import annotations

import numpy as np
import torch

from vig.scene.light import COSINE_LOBE, sh_basis
from vig.synthesis.raster.gloom import directions, run_sweep
from vig.synthesis.raster.native import workspace
from vig.synthesis.raster.records import GRID, SWEEP, address

CELL = 0.016
"""Metres."""
SIZE = (80, 80, 21)
"""Cells along x and y, centred at the object, and planes from z = 0 up."""
RISE = (0.010, 0.0006)
"""Plane s is RISE[0] s + RISE[1] s^2 above the ground: 1 cm apart at first, 3 cm at the top, 0.44 m up."""
OPACITY = 1.3


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
    towards = directions()
    weights = sky_weights(towards, light)
    run_sweep(record, weights, towards, SIZE)
    result = np.zeros(1, GRID)
    result[0] = grid[0]
    return result


def sky_weights(towards: np.ndarray, light: np.ndarray) -> np.ndarray:
    """Irradiance (K, 4) that is lost with the light from each direction (K, 3): v0 and v, see `sweeping`.

    A direction stands for as much of the upper half of the sphere as every other. All together they make up
    what a surface that faces up gets.
    """
    radiance = np.maximum(_basis(towards) @ light, 0.0)
    # A_l Y_l(d) Y_l(n) of degrees 0 and 1: 1 / (4 pi) and d . n / (2 pi), of a solid angle of 2 pi / K.
    weights = np.hstack([np.full((len(towards), 1), 0.5), towards]) * (radiance / len(towards))[:, None]
    whole = max(float(_basis(np.array([[0.0, 0.0, 1.0]]))[0] @ (light * COSINE_LOBE)), 0.0)
    reached = float((weights[:, 0] + weights[:, 3]).sum())
    return weights * (whole / max(reached, 1e-9))


def _basis(directions: np.ndarray) -> np.ndarray:
    """Real orthonormal SH (N, 9) of unit directions (N, 3), as `vig.scene.light.sh_basis`."""
    return sh_basis(torch.from_numpy(directions)).numpy()
