"""Statements of the user about a class that is to be built."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from vig.io.errors import UserError
from vig.scene import Symmetry
from vig_train.building.reading import Scan
from vig_train.building.template import TEMPLATE_VERTICES
from vig_world.assets.things import ZONE_NAMES

USUAL_LENGTH, LENGTHS = 0.2, (0.001, 1000.0)
"""Longest side of a class's mean shape where none is stated, and the bounds of a stated one, metres."""
AXES = {"x": (1, 0, 0), "y": (0, 1, 0), "z": (0, 0, 1), "-x": (-1, 0, 0), "-y": (0, -1, 0), "-z": (0, 0, -1)}


@dataclass(frozen=True)
class BuildSettings:
    """Statements of the user about a class.

    Attributes:
        name: The class's name.
        up: The axis that points up in most files, such as "z"; None: estimated.
        front: The axis that the front faces in most files, such as "+x"; None: estimated.
        shows: Part that the front shows, such as "the handle"; for texts.
        symmetry: "none", "half-turn", "any-turn"; None: estimated.
        length: Longest side of the mean shape, metres; None: `USUAL_LENGTH`, or of a single glTF file, which
            is in metres, its own.
        turns: Degrees by which meshes, by number, are turned counter-clockwise about the vertical at last.
        drops: Numbers of meshes that are left out.
        vertices: Number of vertices of the template, about.
        places: Zones of rooms where such things stand, with relative frequencies.
        materials: Whether colours and textures of the files are kept, for training.
    """

    name: str
    up: str | None = None
    front: str | None = None
    shows: str = ""
    symmetry: str | None = None
    length: float | None = None
    turns: dict[int, float] = field(default_factory=dict)
    drops: tuple[int, ...] = ()
    vertices: int = TEMPLATE_VERTICES
    places: dict[str, float] = field(default_factory=dict)
    materials: bool = True

    def check(self) -> None:
        """Raise UserError when a setting is out of its range."""
        if self.length is not None and not LENGTHS[0] <= self.length <= LENGTHS[1]:
            raise UserError(f"expected a length from 0.001 to 1000 metres; got {self.length:g}. Give metres.")
        min_vertices = 200
        max_vertices = 20_000
        if not min_vertices <= self.vertices <= max_vertices:
            raise UserError(
                f"expected {min_vertices} to {max_vertices} vertices; got {self.vertices}."
                f" Take about {TEMPLATE_VERTICES}."
            )
        for text in (self.name, self.shows or "-"):
            if not text or len(text) > 100 or not text.isprintable():
                raise UserError(f"expected names of 1 to 100 printable characters; got {text[:100]!r}.")
        for axis in (self.up, self.front):
            if axis is not None:
                axis_vector(axis)
        if self.up and self.front and not np.cross(axis_vector(self.up), axis_vector(self.front)).any():
            raise UserError(f"expected a front that is level; got {self.front} with {self.up} up.")
        if self.symmetry is not None and self.symmetry not in set(Symmetry):
            raise UserError(f"expected a symmetry among {', '.join(Symmetry)}; got '{self.symmetry}'.")
        if unknown := sorted(set(self.places) - set(ZONE_NAMES)):
            raise UserError(f"expected places among {', '.join(ZONE_NAMES)}; got '{unknown[0]}'.")

    def used_meshes(self, count: int) -> list[int]:
        """Return indices, from 0, of those of `count` meshes that are not dropped.

        Raises UserError when a number in `turns` or `drops` is no mesh's, or every mesh is dropped.
        """
        for number in (*self.turns, *self.drops):
            if not 1 <= number <= count:
                raise UserError(f"expected numbers of meshes from 1 to {count}; got {number}.")
        used = [index for index in range(count) if index + 1 not in self.drops]
        if not used:
            raise UserError("expected at least one mesh that is not dropped; got none.")
        return used

    def length_of(self, scans: Sequence[Scan]) -> tuple[float, bool]:
        """Return the longest side of the mean shape of these meshes' class, metres; whether it is known."""
        if self.length is not None:
            return self.length, True
        if len(scans) == 1 and scans[0].name.lower().endswith((".glb", ".gltf")):
            own = float(np.ptp(scans[0].vertices, axis=0).max())
            if LENGTHS[0] <= own <= LENGTHS[1]:
                return own, not fills_unit_cube(own)
        return USUAL_LENGTH, False


def fills_unit_cube(length: float) -> bool:
    """Return whether a longest side is that of meshes filling [-0.5, 0.5] or [-1, 1], as generators write."""
    # Some that scale meshes into a unit cube leave 1 %.
    return min(abs(length - 1), abs(length / 2 - 1)) < 0.011


def axis_vector(name: str) -> np.ndarray:
    """Return the unit vector (3,) of an axis such as "+x"; UserError for others."""
    axis = AXES.get(name.lower().removeprefix("+"))
    if axis is None:
        raise UserError(f"expected an axis such as +x, -y or z; got '{name}'.")
    return np.array(axis, float)
