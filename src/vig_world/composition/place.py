"""Places the object: a furnished room, one of its supports, a spot there, and the camera."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from vig.io.errors import UserError
from vig.scene import ObjectClass
from vig_world.assets.props import ZONE_NAMES
from vig_world.composition.stage import Actor, StagedRoom
from vig_world.dataset.spec import Room, Surface
from vig_world.library import Library
from vig_world.rooms import EMPTY, Layout

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
    places = _Places.draw(layout, actor, hidden[0] > 0, rng)
    for place in places.sifted(layout, actor, hidden[0] > 0, rejected):
        chosen = int(places.support[place])

        def stage_at(slid: float, place: int = place, chosen: int = chosen) -> StagedRoom:
            origin, turn = places.pose(place, slid)
            zone = layout.supports[chosen].zone
            return StagedRoom.empty(library, actor, Room(number, chosen, zone, origin, turn, finishes))

        stage = _hiding(stage_at, hidden)
        share = stage.hidden()
        if not hidden[0] <= share <= hidden[1]:
            rejected["place hides too much" if share > hidden[1] else "place hides too little"] += 1
        elif np.isinf(stage.behind).any():
            rejected["place open"] += 1  # beside a window, for example: nothing is behind the object
        elif layout.kind == EMPTY:
            return stage  # what is near its eye is the ground alone
        elif (stage.behind < actor.nearest).mean() > MOST_NEAR or not _eye_is_free(
            layout, _eye_of(stage), actor
        ).all():
            rejected["place near"] += 1
        else:
            return stage
    return None


def _hiding(stage_at: Callable[[float], StagedRoom], hidden: tuple[float, float]) -> StagedRoom:
    """A stage moved out, by 0 to 1, from under what hides more of the object than wanted."""
    stage = stage_at(0.0)
    if hidden[0] == 0 or stage.hidden() <= hidden[1]:
        return stage
    low, high = 0.0, 1.0
    for _ in range(SLIDES):
        slid = (low + high) / 2
        stage = stage_at(slid)
        share = stage.hidden()
        if hidden[0] <= share <= hidden[1]:
            break
        low, high = (slid, high) if share > hidden[1] else (low, slid)
    return stage


def _eye_of(stage: StagedRoom) -> np.ndarray:
    """The camera's position (1, 3) in the layout."""
    room = stage.room
    return (stage.actor.view.eye - np.array(room.origin))[None] @ room.rotation()


@dataclass(frozen=True)
class _Places:
    """Proposals, N of them.

    support: (N,) its number; clearance: (N,) metres above it. turn: (N,) radians, layout to world. spot:
    (N, 3) of the object in the layout; slide: (N, 3) from there to the support's edge on the side of the
    people. fits: (N,) whether the object has room there. eye: (N, 3), the camera in the layout.
    """

    support: np.ndarray
    clearance: np.ndarray
    turn: np.ndarray
    spot: np.ndarray
    slide: np.ndarray
    fits: np.ndarray
    eye: np.ndarray

    @staticmethod
    def draw(layout: Layout, actor: Actor, hiding: bool, rng: np.random.Generator) -> _Places:
        """Zones as the class wants them, any support in a zone; seen from where people stand."""
        supports, count = layout.supports, PROPOSALS[hiding]
        table = _support_table(layout, zone_weights(actor.object_class))
        weights = table["weight"]
        somewhere = layout.kind in ("seamless", EMPTY) or weights.any()  # these are for all things
        weights = weights if weights.any() else np.ones(len(supports))
        if hiding:
            weights = weights * np.where(table["clearance"] < LOW_COVER, COVERED, 1.0)
        chosen = rng.choice(len(supports), count, p=weights / weights.sum())
        rows = table[chosen]
        own_turn, half, centre, clearance = rows["turn"], rows["half"], rows["centre"], rows["clearance"]
        open_all_round = ~np.isfinite(rows["behind"])

        anywhere = open_all_round | (rng.uniform(size=count) > WALL_SHARE) | hiding
        spread = np.where(anywhere, np.pi, 1.25) * rng.uniform(-1, 1, count)
        # The camera is towards -`ahead`; people stand at -y of the support's axes.
        facing = np.arctan2(actor.ahead[1], actor.ahead[0]) - np.pi / 2 + spread
        c, s = np.cos(facing), np.sin(facing)
        to_own = np.stack([c, s, -s, c], axis=1).reshape(count, 2, 2)
        along = to_own @ actor.body.outline.T
        least, most = EDGE - half - along.min(2), half - EDGE - along.max(2)  # of the object's origin
        reach = most - least
        near = np.where(
            rng.uniform(size=count) < 0.7, np.minimum(1.0, 0.5 / np.maximum(reach[:, 1], 0.01)), 1.0
        )
        share = rng.uniform(size=(count, 2)) * np.stack([np.ones(count), near], axis=1)
        own = least + reach * share  # near the people on deep supports, anywhere along them
        fits = somewhere & (reach >= 0).all(1) & (actor.body.heights[1] <= clearance - EDGE)
        turn = facing - own_turn
        spot = centre + _turned(np.column_stack([own, np.zeros(count)]), own_turn)
        to_edge = np.column_stack([np.zeros(count), least[:, 1] - own[:, 1], np.zeros(count)])
        eye = spot + _turned(np.broadcast_to(actor.view.eye, (count, 3)), -turn)
        return _Places(chosen, clearance, turn, spot, _turned(to_edge, own_turn), fits, eye)

    def sifted(self, layout: Layout, actor: Actor, hiding: bool, rejected: Counter[str]) -> Iterator[int]:
        """Numbers of places with object and camera free and, if hiding, furniture in the line of sight."""
        rejected["place too small"] += int((~self.fits).sum())
        fits = np.flatnonzero(self.fits)
        order = fits[_eye_is_free(layout, self.eye[fits], actor)]
        rejected["place eye"] += len(fits) - len(order)
        if hiding:
            middle = self.spot[order] + [0.0, 0.0, actor.body.heights[1] / 2]
            met = _in_sight(layout, self.eye[order], middle)
            above = self.spot[order, 2] + self.clearance[order]
            met |= self.eye[order, 2] > above  # the camera looks down past a board
            order = order[met]
        yield from order[:MOST_LOOKED_AT].tolist()

    def pose(self, place: int, slid: float) -> tuple[tuple[float, float, float], float]:
        """The layout's origin and turn in the world at one of the places, slid to the edge by 0 to 1."""
        spot = self.spot[place] + slid * self.slide[place]
        x, y, z = (-_turned(spot[None], self.turn[place : place + 1])[0]).tolist()
        return (x, y, z), float(self.turn[place])


@lru_cache(maxsize=256)
def _support_table(layout: Layout, places: tuple[tuple[str, float], ...]) -> np.ndarray:
    """A layout's supports as records (N,), with the weight of each, see `zone_weights`."""
    zones, wanted = [support.zone for support in layout.supports], dict(places)
    return np.array(
        [
            (wanted.get(each.zone, 0.0) / zones.count(each.zone), each.turn, each.clearance, each.behind,
             each.half, each.centre)
            for each in layout.supports
        ],
        [("weight", "f8"), ("turn", "f8"), ("clearance", "f8"), ("behind", "f8"),
         ("half", "f8", 2), ("centre", "f8", 3)],
    )  # fmt: skip


def _turned(points: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """Points (N, 3), each turned by its angle (N,) radians about +Z."""
    c, s = np.cos(angle), np.sin(angle)
    x, y, z = points.T
    return np.stack([c * x - s * y, s * x + c * y, z], axis=1)


def _eye_is_free(layout: Layout, eye: np.ndarray, actor: Actor) -> np.ndarray:
    """Whether cameras (N, 3) are inside the room and outside its furniture, with some space: (N,) bool.

    On the ground of an empty hall they may lie.
    """
    clearance = EYE_CLEARANCE * actor.small
    lowest = 0.0 if layout.kind == EMPTY else LOWEST_EYE * actor.small
    free = (eye[:, 2] > lowest) & (eye[:, 2] < layout.height - clearance)
    start, end = layout.outline, np.roll(layout.outline, -1, axis=0)
    way, offset = end - start, eye[:, None, :2] - start
    t = np.clip((offset * way).sum(2) / (way**2).sum(1), 0, 1)
    free &= (((offset - t[..., None] * way) ** 2).sum(2) > clearance**2).all(1)
    crosses = (start[:, 1] > eye[:, None, 1]) != (end[:, 1] > eye[:, None, 1])
    at = start[:, 0] + way[:, 0] * offset[..., 1] / np.where(way[:, 1] == 0, 1.0, way[:, 1])
    free &= (crosses & (at > eye[:, None, 0])).sum(1) % 2 == 1
    if len(layout.solids):
        sides, low, high = _half_spaces(layout, clearance)
        outside = _along(sides, eye) - sides[..., 2]
        inside = (outside <= 0).all(2) & (eye[:, 2:] > low) & (eye[:, 2:] < high)
        free &= ~inside.any(1)
    return free


def _in_sight(layout: Layout, eye: np.ndarray, middle: np.ndarray) -> np.ndarray:
    """Whether the lines from cameras to objects (N, 3) pass furniture: (N,) bool."""
    if not len(layout.solids):
        return np.zeros(len(eye), bool)
    sides, low, high = _half_spaces(layout, NEAR_RAY)
    way = middle - eye
    # Along the line, height over each of the six planes is a + b t, negative inside.
    a, b = _along(sides, eye) - sides[..., 2], _along(sides, way)
    z, up = eye[:, 2:, None], np.broadcast_to(way[:, 2:, None], (*a.shape[:2], 1))
    a = np.concatenate([a, low[:, None] - z, z - high[:, None]], axis=2)
    b = np.concatenate([b, -up, up], axis=2)
    at = -a / np.where(np.abs(b) < 1e-9, 1e-9, b)
    enters = np.where(b < 0, at, -np.inf).max(2)
    leaves = np.where(b > 0, at, np.inf).min(2)
    return ((enters < leaves) & (leaves > 0.1) & (leaves < 0.95) & (enters < 0.9)).any(1)


def _along(sides: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Vectors (N, 3) along the outward normals of sides (M, 4, 3): (N, M, 4)."""
    return (vectors[:, :2] @ sides[..., :2].reshape(-1, 2).T).reshape(len(vectors), *sides.shape[:2])


@lru_cache(maxsize=512)
def _half_spaces(layout: Layout, margin: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Furniture grown by `margin`: (M, 4, 3) outward normal and offset of sides; lowest, highest z (M,)."""
    corners = layout.solids[:, :4]
    way = np.roll(corners, -1, axis=1) - corners
    normal = np.stack([way[..., 1], -way[..., 0]], axis=2) / np.linalg.norm(way, axis=2, keepdims=True)
    offset = (normal * corners).sum(2, keepdims=True) + margin
    return (
        np.concatenate([normal, offset], axis=2),
        layout.solids[:, 4, 0] - margin,
        layout.solids[:, 4, 1] + margin,
    )
