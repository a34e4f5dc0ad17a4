"""A room with the object in it, filled prop by prop; what is hidden is kept up to date."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from vig.scene import ObjectClass
from vig.synthesis.footprint import Footprint, extreme_points
from vig.synthesis.furniture import Support
from vig.synthesis.library import Library
from vig.synthesis.raster import Item, Target, depth
from vig.synthesis.spec import Placed, Room
from vig.synthesis.view import View

LAYOUT_SIZE = 75
"""Pixels on a side of the masks on which placements are judged."""
MARGIN = 0.004
"""Metres between any two things."""
NEAREST = 0.12
"""Nothing comes nearer to the eye's image plane than this, metres."""


@dataclass(frozen=True)
class Actor:
    """The object as seen from its eye.

    item: its geometry. depth: (75, 75) metres, the object alone, inf = nothing; pixels: flat numbers of those
    that show it, own: their depths, sums: (76, 76) how many of them lie above and left of each corner. body:
    its bound. ahead, aside: unit vectors (3,) in the ground plane, away from the eye and to its right.
    """

    item: Item
    azimuth: float
    elevation: float
    view: View
    body: Footprint
    depth: np.ndarray
    pixels: np.ndarray
    own: np.ndarray
    sums: np.ndarray
    ahead: np.ndarray
    aside: np.ndarray

    @staticmethod
    def of(object_class: ObjectClass, vertices: np.ndarray, azimuth: float, elevation: float) -> Actor:
        """The object (V, 3) at the origin, seen from angles in radians."""
        view = View.of(object_class, azimuth, elevation, LAYOUT_SIZE)
        modes = object_class.shape_model.modes
        dark = Target.of(object_class, vertices, np.zeros(modes), np.zeros(3), np.zeros(9))
        item = Item(dark.packed, np.eye(3), np.zeros(3))
        alone = depth([item], view)[0]
        return Actor(
            item=item,
            azimuth=azimuth,
            elevation=elevation,
            view=view,
            body=Footprint.of(extreme_points(vertices), view.forward),
            depth=alone,
            pixels=np.flatnonzero(np.isfinite(alone)),
            own=alone[np.isfinite(alone)],
            sums=np.pad(np.isfinite(alone), ((1, 0), (1, 0))).astype(np.int64).cumsum(0).cumsum(1),
            ahead=np.array([-np.sin(azimuth), np.cos(azimuth), 0.0]),
            aside=np.array([np.cos(azimuth), np.sin(azimuth), 0.0]),
        )


@dataclass
class Stage:
    """Where a scene is put together.

    support: what the object stands on, in the layout's frame. behind, blockers: (75, 75) metres, inf =
    nothing: the room, and the nearest of room and props. solids: bounds of the props so far.
    """

    library: Library
    actor: Actor
    room: Room
    support: Support
    behind: np.ndarray
    blockers: np.ndarray
    props: list[Placed] = field(default_factory=list)
    solids: list[Footprint] = field(default_factory=list)

    @staticmethod
    def empty(library: Library, actor: Actor, room: Room) -> Stage:
        """A furnished room with the object alone."""
        packed = library.packed_layout(room.layout)
        behind, _ = depth([Item(packed, room.rotation(), np.array(room.origin))], actor.view)
        support = library.layout(room.layout).supports[room.support]
        return Stage(library, actor, room, support, behind, behind)

    def hidden(self, extra: np.ndarray | None = None) -> float:
        """Share of the object's pixels behind room and props, or behind one more depth image (75, 75)."""
        pixels, own = self.actor.pixels, self.actor.own
        hidden = self.blockers.ravel()[pixels] < own
        if extra is not None:
            hidden |= extra.ravel()[pixels] < own
        return np.count_nonzero(hidden) / len(pixels)

    def hidden_at_most(self, points: np.ndarray) -> float:
        """A bound of `hidden` with world points (N, 3) before the object, from their window in the frame."""
        rows, columns = self.actor.view.window(points)
        sums = self.actor.sums
        inside = sums[rows.stop, columns.stop] - sums[rows.start, columns.stop]
        inside -= sums[rows.stop, columns.start] - sums[rows.start, columns.start]
        return self.hidden() + float(inside) / len(self.actor.pixels)

    def seen_at(self, placed: list[Placed], shift: np.ndarray | None = None) -> np.ndarray:
        """Depth (75, 75) of props alone, all of them moved by `shift` (3,)."""
        offset = np.zeros(3) if shift is None else shift
        items = [
            Item(self.library.packed(p.family, p.asset), p.matrix(), np.array(p.position) + offset)
            for p in placed
        ]
        return depth(items, self.actor.view)[0]

    def points(self, placed: Placed) -> np.ndarray:
        """Farthest points (N, 3) of a prop in the world."""
        return self.library.extremes(placed.family, placed.asset) @ placed.matrix().T + placed.position

    def check(self, footprint: Footprint) -> str:
        """Why a solid cannot be there: `collision`, `eye` or an empty string."""
        if footprint.depths[0] < self.actor.view.forward @ self.actor.view.eye + NEAREST:
            return "eye"
        clear = all(footprint.clear_of(solid, MARGIN) for solid in [self.actor.body, *self.solids])
        return "" if clear else "collision"

    def carries(self, support: Support, points: np.ndarray) -> bool:
        """Whether world points (N, 3) lie within the edges of a support, and below what is above it."""
        x, y, z = self.on_support(support, points).T
        inside = np.abs(x).max() <= support.half[0] - MARGIN and np.abs(y).max() <= support.half[1] - MARGIN
        return bool(inside and z.max() <= support.clearance - MARGIN)

    def on_support(self, support: Support, points: np.ndarray) -> np.ndarray:
        """World points (N, 3) along a support's own axes from its centre."""
        local = (points - np.array(self.room.origin)) @ self.room.rotation()
        c, s = np.cos(support.turn), np.sin(support.turn)
        return (local - np.array(support.centre)) @ np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])

    def from_support(self, support: Support, points: np.ndarray) -> np.ndarray:
        """The inverse of `on_support`."""
        c, s = np.cos(support.turn), np.sin(support.turn)
        local = points @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]) + np.array(support.centre)
        return self.room.to_world(local)

    def add(self, placed: list[Placed], footprints: list[Footprint], seen: np.ndarray | None) -> None:
        """Keep props, given with their footprints and their common depth image, if they hide anything."""
        self.props += placed
        self.solids += footprints
        if seen is not None:
            self.blockers = np.minimum(self.blockers, seen)
