"""Pieces of furniture: parts, and the surfaces on which things stand."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from vig_world.assets.props.material import Material
from vig_world.mesh import Mesh


@dataclass(frozen=True)
class Support:
    """A level rectangle on which things stand.

    Attributes:
        zone: What it is used for, which decides what stands there; one of
            `vig_world.assets.props.ZONE_NAMES`.
        centre: (x, y, z) metres.
        half: Half its extents along its own axes.
        turn: Radians about +Z from its owner's x axis to its own.
        clearance: Free metres above it (a shelf's next board); inf where nothing is above.
        behind: Metres from its edge at +y of its own axes to the wall, back or thing that closes that side,
            inf where it is open; -y is where people stand.
    """

    zone: str
    centre: tuple[float, float, float]
    half: tuple[float, float]
    turn: float = 0.0
    clearance: float = float("inf")
    behind: float = float("inf")

    def moved(self, offset: tuple[float, float, float], turn: float) -> Support:
        """The same after its owner was turned by `turn` radians about +Z and then shifted."""
        x, y, z = self.centre
        c, s = np.cos(turn), np.sin(turn)
        centre = (float(c * x - s * y + offset[0]), float(s * x + c * y + offset[1]), z + offset[2])
        return Support(self.zone, centre, self.half, self.turn + turn, self.clearance, self.behind)


@dataclass(frozen=True)
class Furniture:
    """A piece of furniture, metres, standing on z = 0 with its bounding box centred at x = y = 0.

    Its front, from which it is used, faces -Y.

    Attributes:
        parts: Meshes with texture coordinates and their materials.
    """

    family: str
    parts: tuple[tuple[Mesh, Material], ...]
    supports: tuple[Support, ...]


Maker = Callable[[np.random.Generator], Furniture]

FAMILIES: dict[str, Maker] = {}
"""Every family of furniture by name: a function from a generator to a piece."""


def family(make: Maker) -> Maker:
    """Register the decorated function as the maker of a family, named like the function."""
    FAMILIES[make.__name__] = make
    return make
