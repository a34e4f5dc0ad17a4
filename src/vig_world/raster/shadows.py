"""Shadows and ambient occlusion: how much light surfaces take from each other.

Points are scattered over surfaces; each makes its cell of a grid a little opaque. For each of K directions of
light a plane of shadow is swept down through the grid: the shadow in a plane is that of the plane above,
shifted along the direction and thereby a little blurred, joined with the opacity of the cells between. The
light lost from a direction is kept as the irradiance that a normal loses, in harmonics of degree 0 and 1:
lost(n) = v0 + v . n.
"""

import functools

import numpy as np

from vig.scene.light import COSINE_LOBE, sh_basis
from vig_native import engine

BOUNCE = 0.25  # share of the blocked light that returns by reflection, from the blocker or its surroundings

MAX_CELLS = 72
REACH = 0.5  # metres of height over which a blocker's effect fades to 1 / e: rooms are closed, and yet light


def ambient_occlusion(vertices: np.ndarray, faces: np.ndarray) -> dict[str, np.ndarray]:
    """Compute how much irradiance a room's own surfaces block, under uniform light of radiance 1.

    Args:
        vertices: (V, 3) metres.
        faces: (F, 3).

    Returns:
        `ambient` (z, y, x, 4) int16, and `ambient_frame`, the grid's origin (3), cell and scale, as the
        rasteriser takes them.
    """
    low, high = vertices.min(0), vertices.max(0)
    # 12 cm; more where a room would need more than MAX_CELLS along a side
    cell = max(0.12, float((high - low).max()) / MAX_CELLS)
    points = surface_points(vertices, faces, cell**2 / 3)
    origin = low.astype(np.float64) - 1.5 * cell
    x, y, z = (np.ceil((high - origin) / cell).astype(int) + 3).tolist()
    lanes = 16  # cells that native code sweeps side by side: a grid's width is a multiple of it
    x = -(-x // lanes) * lanes
    # Places along x and y are of cells' centres, and cells lie between planes along z.
    cells = np.floor((points[:, :3] - origin) / cell + [0.5, 0.5, 0.0]).astype(np.int64)
    flat = (cells[:, 2] * y + cells[:, 1]) * x + cells[:, 0]
    opacity = np.bincount(flat, points[:, 3] / cell**2, minlength=(z - 1) * y * x).astype(np.float32)
    lost = np.zeros((z, y, x, 4), np.float32)
    for side in (1, -1):
        light = directions() * [1, 1, side]
        weights = np.hstack([np.ones((len(light), 1)), 2 * light]) / (2 * len(light))
        turned = np.ascontiguousarray(opacity.reshape(z - 1, y, x)[::side])
        values, scale = engine.sweep(turned, cell, slopes(), weights.astype(np.float32), REACH)
        lost += values[::side] * np.float32(scale)
    scale = np.float32(np.abs(lost).max() / 32000 + 1e-12)
    frame = np.array([*origin, cell, scale], np.float32)
    return {"ambient": (lost / scale).astype(np.int16), "ambient_frame": frame}


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
    """Return unit vectors (K, 3) spread over the upper hemisphere."""
    rows = []
    # elevations in degrees, and how many directions are spread evenly over each
    for ring, (elevation, count) in enumerate(((90.0, 1), (60.0, 5), (32.0, 6))):
        rise = np.radians(elevation)
        turn = 2 * np.pi * (np.arange(count) + 0.5 * (ring % 2)) / count
        rows.append(
            np.stack([np.cos(rise) * np.cos(turn), np.cos(rise) * np.sin(turn), 0 * turn + np.sin(rise)], 1)
        )
    return np.concatenate(rows)


@functools.cache
def slopes() -> np.ndarray:
    """Return metres along x and y (K, 2) float32 per metre of height of each of `directions`."""
    towards = directions()
    return np.ascontiguousarray(towards[:, :2] / towards[:, 2:], np.float32)


def sky_weights(light: np.ndarray) -> np.ndarray:
    """Return irradiance (K, 4) lost with the light from each of `directions`: v0 and v, as the module says.

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
    """Return SH (K + 1, 9) of the directions and of straight up; weights (K, 4) of radiance 1 from each."""
    towards = directions()
    basis = sh_basis(np.concatenate([towards, [[0.0, 0.0, 1.0]]]))
    # A_l Y_l(d) Y_l(n) of degrees 0 and 1: 1 / (4 pi) and d . n / (2 pi), of a solid angle of 2 pi / K.
    return basis, np.hstack([np.full((len(towards), 1), 0.5), towards]) / len(towards)
