"""Boards and walls with rectangular openings."""

from __future__ import annotations

import numpy as np

from vig_world.mesh import Mesh

Hole = tuple[float, float, float, float]
"""x0, y0, x1, y1 of an opening."""


def cells(low: tuple[float, float], high: tuple[float, float], holes: list[Hole]) -> list[Hole]:
    """Rectangles that together cover the rectangle low..high but for its holes, all on one grid of lines."""
    xs = sorted({low[0], high[0], *(hole[0] for hole in holes), *(hole[2] for hole in holes)})
    ys = sorted({low[1], high[1], *(hole[1] for hole in holes), *(hole[3] for hole in holes)})
    result = []
    for a, c in zip(xs[:-1], xs[1:], strict=True):
        for b, d in zip(ys[:-1], ys[1:], strict=True):
            x, y = (a + c) / 2, (b + d) / 2
            if not any(h[0] < x < h[2] and h[1] < y < h[3] for h in holes):
                result.append((a, b, c, d))
    return result


def pierced(
    low: tuple[float, float], high: tuple[float, float], z0: float, z1: float, holes: list[Hole]
) -> Mesh:
    """A level board with rectangular openings, closed; its texture runs on as if it were one board."""
    quads = []
    for a, b, c, d in cells(low, high, holes):
        quads.append([(a, b, z1), (c, b, z1), (c, d, z1), (a, d, z1)])
        quads.append([(a, d, z0), (c, d, z0), (c, b, z0), (a, b, z0)])
    xs = sorted({low[0], high[0], *(hole[0] for hole in holes), *(hole[2] for hole in holes)})
    ys = sorted({low[1], high[1], *(hole[1] for hole in holes), *(hole[3] for hole in holes)})
    for (a, b, c, d), inward in [((*low, *high), False), *((hole, True) for hole in holes)]:
        ring = [*((x, b) for x in xs if a <= x < c), *((c, y) for y in ys if b <= y < d)]
        ring += [*((x, d) for x in xs[::-1] if a < x <= c), *((a, y) for y in ys[::-1] if b < y <= d)]
        for (px, py), (qx, qy) in zip(ring, [*ring[1:], ring[0]], strict=True):
            side = [(px, py, z0), (qx, qy, z0), (qx, qy, z1), (px, py, z1)]
            quads.append(side[::-1] if inward else side)
    points = np.array(quads)
    level = np.ptp(points[:, :, 2], axis=1) == 0
    flat = points[:, :, [1, 0]]
    upright = np.stack([points[:, :, 2], points[:, :, 0] + points[:, :, 1]], -1)
    uv = np.where(level[:, None, None], flat, upright)
    faces = np.array([[0, 1, 2], [0, 2, 3]])[None] + 4 * np.arange(len(quads))[:, None, None]
    return Mesh(
        points.reshape(-1, 3).astype(np.float32),
        faces.reshape(-1, 3).astype(np.int32),
        uv.reshape(-1, 2).astype(np.float32),
    )
