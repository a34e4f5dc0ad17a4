"""A furnished room, and the material of its supports."""

from dataclasses import dataclass

import numpy as np

from vig_world.assets.things import Material, Support
from vig_world.mesh import Mesh

LEVEL = 0.012  # metres by which the surface may lie above or below the support's height


@dataclass(frozen=True, eq=False)
class Layout:
    """A furnished room, metres, its floor at z = 0; shared by all samples that use it, and the same as itself
    only.

    Attributes:
        kind: Kitchen, dining room, living room ...
        parts: Floor, walls, ceiling, built-in parts (windows, doors, skirting, lamps) and all furniture, in
            the layout's frame.
        supports: Surfaces where things may stand, the floor too.
        outline: (N, 2) corners of the floor, counter-clockwise; four of a box, six of an L.
        height: Height of the ceiling.
        solids: (M, 5, 2) furniture that stands in the way: four corners in the ground plane,
            counter-clockwise, and a row with its lowest and highest z.
    """

    kind: str
    parts: tuple[tuple[Mesh, Material], ...]
    supports: tuple[Support, ...]
    outline: np.ndarray
    height: float
    solids: np.ndarray


def material_under(layout: Layout, support: Support) -> Material | None:
    """Return the material of the highest surface at the middle of a support, None where none is near."""
    x, y, z = support.centre
    highest, material_found = -np.inf, None
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
            highest, material_found = top, material
    return material_found


def _area(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> np.ndarray:
    """Return twice the signed area of triangles with corners (N, 2) or (2,)."""
    u, v = b - a, c - a
    return u[..., 0] * v[..., 1] - u[..., 1] * v[..., 0]
