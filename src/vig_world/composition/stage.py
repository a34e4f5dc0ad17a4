"""A room with the object in it, filled prop by prop, with the current occlusion of the object."""

import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from vig.scene import ObjectClass
from vig_native import engine
from vig_world.assets.footprint import Footprint, extreme_points
from vig_world.assets.things import Support
from vig_world.dataset.spec import Placed, Room
from vig_world.library import Library
from vig_world.raster.draw import depth
from vig_world.raster.items import Item, Target
from vig_world.raster.settle import ObjectPixels, settle
from vig_world.raster.view import View
from vig_world.renderers.rasterized import items_of
from vig_world.rotations import about_z

LAYOUT_SIZE = 75  # pixels on a side of the masks by which placements are evaluated
MARGIN = 0.004  # metres between any two things
NEAREST = 0.09
"""Least depth of anything in a scene, metres; less where things smaller than teapots are seen from nearer."""

MIN_GAP, WIDEST_GAP = 0.002, 0.1  # metres between the object and occluders before it
HAND_INSIDE = 6  # least distance of holding fingertips from the edge of the layout's frame, pixels
SMALL = 0.25
"""Scale of the object below which the camera's distance from ground and furniture is its multiple."""


@dataclass(frozen=True)
class Actor:
    """The object as seen from its camera.

    Attributes:
        object_class: Class of the object.
        item: Its geometry.
        depth: (75, 75) metres, the object alone; inf where it is not.
        pixels: Flat indices of the pixels that show it.
        own: Depths of these pixels.
        sums: (76, 76), number of them above and left of each corner.
        middle: Mean row and column, pixels.
        body: Its bound.
        ahead: Unit vector (3,) in the ground plane, away from the camera.
        aside: Unit vector (3,) in the ground plane, to the camera's right.
    """

    object_class: ObjectClass
    item: Item
    elevation: float
    view: View
    body: Footprint
    depth: np.ndarray
    pixels: np.ndarray
    own: np.ndarray
    sums: np.ndarray
    middle: tuple[float, float]
    ahead: np.ndarray
    aside: np.ndarray

    @staticmethod
    def of(
        view: View, object_class: ObjectClass, vertices: np.ndarray, elevation: float, azimuth: float
    ) -> "Actor":
        """Return the object (V, 3) at the origin, seen in a view of `LAYOUT_SIZE` from angles in radians."""
        modes = object_class.shape_model.modes
        dark = Target.of(object_class, vertices, np.zeros(modes), np.zeros(3), np.zeros(9))
        item = Item(dark.packed, np.eye(3), np.zeros(3))
        alone = depth([item], view)[0]
        shown = np.isfinite(alone)
        rows, columns = np.nonzero(shown)
        sums = np.zeros((alone.shape[0] + 1, alone.shape[1] + 1), np.int64)
        np.cumsum(shown.cumsum(0), axis=1, out=sums[1:, 1:])
        return Actor(
            object_class=object_class,
            item=item,
            elevation=elevation,
            view=view,
            body=Footprint.of(extreme_points(vertices), view.forward),
            depth=alone,
            pixels=np.flatnonzero(shown),
            own=alone[shown],
            sums=sums,
            middle=(float(rows.mean()) + 0.5, float(columns.mean()) + 0.5),
            ahead=np.array([-np.sin(azimuth), np.cos(azimuth), 0.0]),
            aside=np.array([np.cos(azimuth), np.sin(azimuth), 0.0]),
        )

    @cached_property
    def front(self) -> float:
        """Return its reach from its axis towards the camera, metres."""
        return float((self.body.outline @ -self.ahead[:2]).max())

    @cached_property
    def scale(self) -> float:
        """Return its size over a teapot's; see `ObjectClass.scale`."""
        return self.object_class.scale

    @property
    def small(self) -> float:
        """Return its `scale` if it is smaller than 7 cm or so, whose camera is near its support; else 1."""
        return self.scale if self.scale < SMALL else 1.0

    @property
    def nearest(self) -> float:
        """Return the least depth of anything in the scene, metres."""
        return NEAREST * min(1.0, self.scale)


@dataclass
class StagedRoom:
    """A scene under construction.

    Attributes:
        support: Support of the object, in the layout's frame.
        behind: Depth (75, 75) of the room, metres; inf where there is nothing.
        blockers: Depth of the nearest of room and props, in the same form.
        solids: Bounds of the props so far.
        halvings: Number of times that occluders are halved in size and in their distance from other things.
        closer: Whether held occluders are as often near the camera as near the object, on a log scale.
    """

    library: Library
    actor: Actor
    room: Room
    support: Support
    behind: np.ndarray
    blockers: np.ndarray
    props: list[Placed] = field(default_factory=list)
    solids: list[Footprint] = field(default_factory=list)
    halvings: int = 0
    closer: bool = False
    _poses: dict[Support, tuple[np.ndarray, np.ndarray]] = field(default_factory=dict)
    _hidden: np.ndarray | None = None
    _obstacles: Footprint | None = None

    @cached_property
    def native(self) -> Any:
        """Return the same stage in the native library, made when it is first used to hide the object."""
        actor, (axes, origin) = self.actor, self.pose(self.support)
        numbers = (
            *actor.middle, actor.front, float(actor.body.depths[0]), actor.scale, self.margin, self.nearest,
            MIN_GAP * 0.5**self.halvings, WIDEST_GAP * actor.scale * math.cos(actor.elevation),
            *self.support.half, self.support.clearance, HAND_INSIDE,
        )  # fmt: skip
        shown = actor.view.native, actor.sums, len(actor.pixels)
        support = np.ascontiguousarray(axes.T), origin @ axes
        return engine.stage(*shown, self.closer, actor.ahead, actor.aside, *support, numbers)

    @staticmethod
    def empty(library: Library, actor: Actor, room: Room) -> "StagedRoom":
        """Return a furnished room with the object alone."""
        behind, _ = depth(items_of(library, [], room), actor.view)
        support = library.plan(room.layout).layout.supports[room.support]
        return StagedRoom(library, actor, room, support, behind, behind)

    @property
    def margin(self) -> float:
        """Return the least gap between any two things, metres."""
        return MARGIN * 0.5**self.halvings

    @property
    def nearest(self) -> float:
        """Return the least depth of a prop, metres."""
        return max(self.actor.nearest * 0.5**self.halvings, self.actor.view.near)

    def member(self, family: str, number: int) -> tuple[str, int]:
        """Return member `number` of a family, made smaller."""
        return family, number + self.halvings * self.library.members(family)

    def families(self, zone: str) -> tuple[str, ...]:
        """Return the families of props that belong in a zone, but for those like the object."""
        return self.library.families(zone, self.actor.object_class.name)

    def hidden_share(self, extra: np.ndarray | None = None) -> float:
        """Return the share of the object's pixels behind room and props, or one more depth image (75, 75)."""
        hidden, actor = self._hidden_pixels(), self.actor
        if extra is not None:
            hidden = hidden | (extra.ravel()[actor.pixels] < actor.own)
        return np.count_nonzero(hidden) / len(actor.pixels)

    def _hidden_pixels(self) -> np.ndarray:
        """Return whether each of the object's pixels is behind room and props: (N,) bool."""
        if self._hidden is None:
            self._hidden = self.blockers.ravel()[self.actor.pixels] < self.actor.own
        return self._hidden

    def depth_of_props(self, placed: list[Placed]) -> np.ndarray:
        """Return the depth (75, 75) of props alone."""
        return depth(items_of(self.library, placed), self.actor.view)[0]

    def settle(
        self,
        placed: list[Placed],
        motion: np.ndarray,
        ends: tuple[float, float],
        level: float,
        tolerance: float,
    ) -> tuple[float, np.ndarray] | str:
        """Return the offset of props along a motion (3,) at which `level` is hidden, see `raster.settle`."""
        actor = self.actor
        pixels = ObjectPixels(actor.pixels, actor.own, self._hidden_pixels())
        return settle(items_of(self.library, placed), actor.view, motion, ends, pixels, level, tolerance)

    def points(self, placed: Placed) -> np.ndarray:
        """Return farthest points (N, 3) of a prop in the world."""
        return self.library.extremes(placed.family, placed.asset) @ placed.matrix().T + placed.position

    def check(self, footprint: Footprint) -> str:
        """Return why a solid cannot be there: `collision`, `eye` (too near the camera) or an empty string."""
        if footprint.depths[0] < self.actor.view.forward @ self.actor.view.eye + self.nearest:
            return "eye"
        return "" if (footprint.gap(self.obstacles()) >= self.margin).all() else "collision"

    def obstacles(self) -> Footprint:
        """Return bounds of the object and of the props so far, as one of shape (N, ...)."""
        if self._obstacles is None:
            self._obstacles = Footprint.stack([self.actor.body, *self.solids])
        return self._obstacles

    def on_support(self, support: Support, points: np.ndarray) -> np.ndarray:
        """Return world points (..., 3) along a support's own axes from its centre."""
        rotation, origin = self.pose(support)
        return points @ rotation - origin @ rotation

    def pose(self, support: Support) -> tuple[np.ndarray, np.ndarray]:
        """Return the rotation (3, 3) and translation (3,), world from a support's own frame."""
        if support not in self._poses:
            rotation = self.room.rotation()
            origin = rotation @ np.array(support.centre) + np.array(self.room.origin)
            self._poses[support] = rotation @ about_z(support.turn), origin
        return self._poses[support]

    def add(self, placed: list[Placed], footprints: list[Footprint], depths: np.ndarray | None) -> None:
        """Keep props, given with their footprints and their common depth image, if they hide anything."""
        self.props += placed
        self.solids += footprints
        self._obstacles = None
        if depths is not None:
            self.blockers, self._hidden = np.minimum(self.blockers, depths), None
