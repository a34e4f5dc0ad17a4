"""Flaws of a mug's design: surfaces folded or in each other's way, and sizes out of proportion."""

import numpy as np

from tools.classes.soundness import crossings, size_flaws
from vig_world.assets.mugs.design import MugDesign
from vig_world.assets.mugs.handle import centre_line
from vig_world.assets.mugs.mug import MUG_FACES, mug_vertices, wall_rows
from vig_world.assets.mugs.wall import inside, outside
from vig_world.mesh import face_normals

HEIGHTS, WIDTHS, LENGTHS = (0.045, 0.18), (0.05, 0.13), (0.065, 0.175)
"""Metres; lengths are from the back to the handle."""
PROPORTIONS = (0.5, 2.1)
"""Height / width of the body."""
REACHES = (0.18, 0.5)
"""Reach of the handle / width of the body."""
_OPENING = 0.007
"""Metres between handle and wall, at the widest."""
_MIN_ROW = 0.0007
"""Metres of wall between the handle's places, and between them and rim or bottom."""
_MIN_WALL = 0.0009
_MIN_ANGLE = 2.5
"""Degrees, of faces."""


def flaws(design: MugDesign) -> list[str]:
    """Return the flaws that make a design no mug, a sentence each; empty for a sound one."""
    outer, inner = outside(design), inside(design)
    flaws_found = []
    if np.diff(wall_rows(design, outer)).min() * outer.length < _MIN_ROW:
        flaws_found.append("the handle's places on the wall leave no room")
    if inner.points[0, 0] < 0.2 * inner.points[:, 0].max():
        flaws_found.append("it is not hollow")
    if (outer.radius(inner.points[:, 1]) - inner.points[:, 0]).min() < _MIN_WALL:
        flaws_found.append("the wall is too thin")
    line = centre_line(design, outer)
    gap = line[:, 0] - 0.5 * design.handle_thickness - outer.radius(line[:, 1])
    if gap.max() < _OPENING:
        flaws_found.append("no finger fits the handle")
    vertices = mug_vertices(design).astype(np.float64)
    if vertices[:, 2].min() < -1e-9:
        flaws_found.append("it reaches below the ground")
    if line[:, 1].max() > 1.08 * design.height:
        flaws_found.append("the handle rises above the rim")
    if thinnest(vertices) < _MIN_ANGLE:
        flaws_found.append("it has slivers")
    width = float(np.ptp(vertices[:, 1]))
    sizes = [
        ("high", vertices[:, 2].max(), HEIGHTS),
        ("wide", width, WIDTHS),
        ("long", float(np.ptp(vertices[:, 0])), LENGTHS),
    ]
    flaws_found += size_flaws(sizes)
    ratios = [
        ("its height over its width", vertices[:, 2].max() / width, PROPORTIONS),
        ("the handle's reach over its width", (vertices[:, 0].max() + vertices[:, 0].min()) / width, REACHES),
    ]
    flaws_found += [
        f"{what} is {ratio:.2f}, not {least} to {most}"
        for what, ratio, (least, most) in ratios
        if not least <= ratio <= most
    ]
    if not flaws_found and crossings(vertices, MUG_FACES):
        flaws_found.append("it cuts into itself")
    return flaws_found


def thinnest(vertices: np.ndarray) -> float:
    """Return the least angle of any face of a mug (V, 3), degrees."""
    corners = vertices[MUG_FACES]
    sides = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
    twice = np.linalg.norm(face_normals(vertices, MUG_FACES), axis=1)
    # The least angle lies between the two longer sides.
    longer = np.sort(sides, axis=1)[:, 1:].prod(axis=1)
    return float(np.degrees(np.arcsin(np.clip(twice / longer, 0.0, 1.0))).min())
