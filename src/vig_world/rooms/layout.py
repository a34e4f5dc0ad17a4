"""What a furnished room is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vig_world.assets.furniture.furniture import Support
from vig_world.assets.props.material import Material
from vig_world.mesh import Mesh


@dataclass(frozen=True)
class Layout:
    """A furnished room, metres, its floor at z = 0; the same for every sample that plays in it.

    kind: kitchen, dining room, living room ... parts: floor, walls, ceiling, what is built in (windows,
    doors, skirting, lamps) and all furniture, in the layout's frame. supports: where things may stand, the
    floor too. outline: (N, 2) corners of the floor, counter-clockwise; four of a box, six of an L. height: of
    the ceiling. solids: (M, 5, 2) furniture that stands in the way: four corners in the ground plane,
    counter-clockwise, and a row with its lowest and highest z.
    """

    kind: str
    parts: tuple[tuple[Mesh, Material], ...]
    supports: tuple[Support, ...]
    outline: np.ndarray
    height: float
    solids: np.ndarray
