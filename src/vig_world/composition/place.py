"""Places the object: a furnished room, one of its supports, a spot there, and the camera."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable
from functools import lru_cache

import numpy as np

from vig.io.errors import UserError
from vig.scene import ObjectClass
from vig_world.assets.props import ZONE_NAMES
from vig_world.composition.stage import Actor, StagedRoom
from vig_world.dataset.spec import Room, Surface
from vig_world.library import Library
from vig_world.raster.native import workspace
from vig_world.raster.records import (
    PLACE,
    PLACE_EYE,
    PLACE_GOOD,
    PLACE_TOO_SMALL,
    PLACES,
    SOLID,
    SUPPORT,
    address,
)  # fmt: skip
from vig_world.rooms import EMPTY, Layout
from vig_world.rotations import about_z

ZONE_WEIGHTS = {
    "dining": 3.0, "drinks": 3.0, "cooking": 3.0, "display": 2.0, "desk": 1.5, "storage": 1.5, "reading": 1.0,
    "bedside": 1.0, "washing": 0.7, "floor": 0.3,
}  # fmt: skip
"""Relative frequency of each zone of a room as the object's place, for classes that name none."""
PROPOSALS = {False: 48, True: 200}
"""Places drawn at a time; more where the room is to hide the object."""
MOST_LOOKED_AT = 16
"""Number of valid places that are rendered."""
EYE_CLEARANCE = 0.06
"""Metres between the camera and walls or furniture."""
LOWEST_EYE = 0.02
"""Metres above the floor."""
MOST_NEAR = 0.02
"""Share of the frame in which something may be nearer than `Actor.nearest`."""
EDGE = 0.01
"""Metres between the object's outline and the edge of what it stands on."""
WALL_SHARE = 0.9
"""Share of views from the side where people stand, for supports with a wall or back behind."""
COVERED, LOW_COVER = 12.0, 0.7
"""Supports with less than this clearance, metres, are likelier by this factor where the room is to hide
the object."""
SLIDES = 5
NEAR_RAY = 0.05
"""Metres from a piece of furniture within which the line of sight counts as meeting it."""


@lru_cache(maxsize=8)
def zone_weights(object_class: ObjectClass) -> tuple[tuple[str, float], ...]:
    """Zones of rooms where things of a class stand, with their relative frequencies, sorted.

    Raises:
        UserError: The class names others.
    """
    if unknown := sorted(object_class.places.keys() - set(ZONE_NAMES)):
        raise UserError(
            f"expected places of class '{object_class.name}' among {', '.join(ZONE_NAMES)};"
            f" got '{unknown[0][:40]}'. Correct its class.json."
        )
    return tuple(sorted((object_class.places or ZONE_WEIGHTS).items()))


def find_place(
    library: Library,
    layouts: range,
    actor: Actor,
    finishes: tuple[tuple[str, Surface], ...],
    hidden: tuple[float, float],
    rng: np.random.Generator,
    rejected: Counter[str],
) -> StagedRoom | None:
    """A stage whose room and furniture hide a share of the object within `hidden`; None if none is found.

    The latents stay fixed: one of the rooms `layouts` is turned and shifted round the object.
    """
    number = int(rng.choice(layouts)) if layouts.start else int(rng.integers(layouts.stop))
    layout = library.plan(number).layout
    proposals = _Proposals(layout, actor, hidden[0] > 0, rng)
    for place in proposals.sifted(rejected):
        support = int(proposals.support[place])

        def stage_at(slid: float, place: int = place, support: int = support) -> StagedRoom:
            origin, turn = proposals.pose(place, slid)
            zone = layout.supports[support].zone
            return StagedRoom.empty(library, actor, Room(number, support, zone, origin, turn, finishes))

        stage, slid = _hiding(stage_at, hidden)
        share = stage.hidden()
        if not hidden[0] <= share <= hidden[1]:
            rejected["place hides too much" if share > hidden[1] else "place hides too little"] += 1
        elif np.isinf(stage.behind).any():
            rejected["place open"] += 1  # beside a window, for example: nothing is behind the object
        elif layout.kind == EMPTY:
            return stage  # what is near its eye is the ground alone
        elif (stage.behind < actor.nearest).mean() > MOST_NEAR or not proposals.is_free(place, slid):
            rejected["place near"] += 1
        else:
            return stage
    return None


def _hiding(stage_at: Callable[[float], StagedRoom], hidden: tuple[float, float]) -> tuple[StagedRoom, float]:
    """A stage moved out, by 0 to 1, from under what hides more of the object than wanted; and by how much."""
    stage = stage_at(0.0)
    if hidden[0] == 0 or stage.hidden() <= hidden[1]:
        return stage, 0.0
    low, high = 0.0, 1.0
    for _ in range(SLIDES):
        slid = (low + high) / 2
        stage = stage_at(slid)
        share = stage.hidden()
        if hidden[0] <= share <= hidden[1]:
            break
        low, high = (slid, high) if share > hidden[1] else (low, slid)
    return stage, slid


class _Proposals:
    """Places in a layout: zones as the class wants them, any support in a zone, seen from where people stand.

    Attributes:
        support: (N,) number of each one's support.
    """

    def __init__(self, layout: Layout, actor: Actor, hiding: bool, rng: np.random.Generator) -> None:
        """Draw them; `hiding`: only such are good that have something before the object."""
        table = _support_table(layout, zone_weights(actor.object_class))
        weights, solids, count = table["weight"], _solid_table(layout), PROPOSALS[hiding]
        self.fits_any = layout.kind in ("seamless", EMPTY) or bool(weights.any())  # these are for all things
        weights = weights if weights.any() else np.ones(len(table))
        if hiding:
            weights = weights * np.where(table["clearance"] < LOW_COVER, COVERED, 1.0)
        self.support = rng.choice(len(table), count, p=weights / weights.sum())
        self._places = np.zeros(count, PLACE)
        body = np.ascontiguousarray(actor.body.outline)
        outline = np.ascontiguousarray(layout.outline, np.float64)
        self._arrays = table, self.support, rng.random((count, 5)), body, outline, solids, self._places
        clearance = EYE_CLEARANCE * actor.small
        self._record = np.array(
            (
                *map(address, self._arrays), 0, count, len(body), len(layout.outline), len(solids), hiding,
                actor.body.heights[1], actor.view.eye, math.atan2(actor.ahead[1], actor.ahead[0]), 0.0,
                # On the ground of an empty hall the camera may lie.
                clearance, 0.0 if layout.kind == EMPTY else LOWEST_EYE * actor.small,
                layout.height - clearance, EDGE, NEAR_RAY, WALL_SHARE,
            ),
            PLACES,
        )  # fmt: skip
        self._run()

    def _run(self) -> None:
        workspace.record("places", PLACES)[0] = self._record
        workspace.launch("places", "places")

    def sifted(self, rejected: Counter[str]) -> list[int]:
        """Numbers of the first good places; the others are counted by what they lack."""
        state = self._places["state"] if self.fits_any else np.full(len(self._places), PLACE_TOO_SMALL)
        for lack, reason in ((PLACE_TOO_SMALL, "too small"), (PLACE_EYE, "eye")):
            rejected[f"place {reason}"] += int(np.count_nonzero(state == lack))
        return np.flatnonzero(state == PLACE_GOOD)[:MOST_LOOKED_AT].tolist()

    def is_free(self, place: int, slid: float) -> bool:
        """Whether the camera is free at one of the places that was free before it was slid."""
        if slid == 0:
            return True
        self._record["first"], self._record["end"], self._record["slid"] = place, place + 1, slid
        self._run()
        return int(self._places["state"][place]) != PLACE_EYE

    def pose(self, place: int, slid: float) -> tuple[tuple[float, float, float], float]:
        """The layout's origin and turn in the world at one of the places, slid to the edge by 0 to 1."""
        at = self._places[place]
        turn = float(at["turn"])
        x, y, z = (-about_z(turn) @ (at["spot"] + slid * at["slide"])).tolist()
        return (x, y, z), turn


@lru_cache(maxsize=256)
def _support_table(layout: Layout, places: tuple[tuple[str, float], ...]) -> np.ndarray:
    """A layout's supports as records (N,), with the weight of each, see `zone_weights`."""
    zones, wanted = [support.zone for support in layout.supports], dict(places)
    rows = [
        (wanted.get(each.zone, 0.0) / zones.count(each.zone), each.turn, each.clearance, each.behind,
         each.half, each.centre)
        for each in layout.supports
    ]  # fmt: skip
    return np.array(rows, SUPPORT)


@lru_cache(maxsize=256)
def _solid_table(layout: Layout) -> np.ndarray:
    """A layout's furniture as SOLID records (M,)."""
    table = np.zeros(len(layout.solids), SOLID)
    if len(table):
        corners = layout.solids[:, :4]
        way = np.roll(corners, -1, axis=1) - corners
        normal = np.stack([way[..., 1], -way[..., 0]], axis=2) / np.linalg.norm(way, axis=2, keepdims=True)
        table["sides"] = np.concatenate([normal, (normal * corners).sum(2, keepdims=True)], axis=2)
        table["low"], table["high"] = layout.solids[:, 4].T
    return table
