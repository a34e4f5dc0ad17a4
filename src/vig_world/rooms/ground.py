"""The material of a support: that of the surface under its middle."""

from __future__ import annotations

import numpy as np

from vig_world.assets.furniture import Support
from vig_world.assets.props.material import Material
from vig_world.rooms.layout import Layout

LEVEL = 0.006
"""Metres by which the surface may lie above or below the support's height."""


def material_under(layout: Layout, support: Support) -> Material | None:
    """The material of the highest surface at the middle of a support, None where there is none near it."""
    x, y, z = support.centre
    highest, found = -np.inf, None
    for mesh, material in layout.parts:
        near = np.abs(mesh.vertices[:, 2] - z) <= LEVEL
        faces = mesh.faces[near[mesh.faces].all(axis=1)]
        if not len(faces):
            continue
        a, b, c = (mesh.vertices[faces[:, k], :2].astype(np.float64) for k in range(3))
        area, middle = _area(a, b, c), np.array([x, y])
        weights = np.stack([_area(middle, b, c), _area(a, middle, c), _area(a, b, middle)], axis=1)
        inside = (np.abs(area) > 1e-12) & (weights * np.sign(area)[:, None] >= -1e-9).all(axis=1)
        if inside.any() and (top := mesh.vertices[faces[inside]][..., 2].max()) > highest:
            highest, found = top, material
    return found


def _area(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> np.ndarray:
    """Twice the signed area of triangles with corners (N, 2) or (2,)."""
    u, v = b - a, c - a
    return u[..., 0] * v[..., 1] - u[..., 1] * v[..., 0]
