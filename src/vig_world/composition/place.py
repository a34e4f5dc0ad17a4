"""Places the object: a furnished room, one of its supports, a spot there, and the camera."""

import math
from collections import Counter
from collections.abc import Callable
from functools import lru_cache

import numpy as np

from vig.io.errors import UserError
from vig.scene import ObjectClass
from vig_native import engine
from vig_world.assets.things import ZONE_NAMES
from vig_world.composition.stage import Actor, StagedRoom
from vig_world.dataset.spec import Room, Surface
from vig_world.library import Library
from vig_world.rooms import unfurnished
from vig_world.rooms.layout import Layout
from vig_world.rooms.unfurnished import EMPTY
from vig_world.rotations import about_z

ZONE_WEIGHTS = {
    "dining": 3.0, "drinks": 3.0, "cooking": 3.0, "display": 2.0, "desk": 1.5, "storage": 1.5, "reading": 1.0,
    "bedside": 1.0, "washing": 0.7, "floor": 0.3,
}  # fmt: skip
"""Relative frequency of each zone of a room as the object's place, for classes that name none."""
PROPOSALS = {False: 48, True: 200}  # places drawn at a time; more where the room is to hide the object
EYE_CLEARANCE = 0.06  # metres between the camera and walls or furniture
LOWEST_EYE = 0.02  # metres above the floor
MAX_NEAR = 0.02  # share of the frame in which something may be nearer than `Actor.nearest`
EDGE = 0.01  # metres between the object's outline and the edge of its support
COVERED, LOW_COVER = 12.0, 0.7
"""Supports with less clearance, metres, are likelier by this factor where the room is to hide the object."""
NEAR_RAY = 0.05  # metres from a piece of furniture within which the line of sight counts as meeting it
BEYOND = unfurnished.RADIUS * math.cos(math.pi / unfurnished.SEGMENTS) - math.sqrt(2) * unfurnished.STANDS
"""Metres from the object, wherever it stands on a seamless ground, within which there is no wall."""


@lru_cache(maxsize=8)
def zone_weights(object_class: ObjectClass) -> tuple[tuple[str, float], ...]:
    """Return zones of rooms where things of a class stand, with their relative frequencies, sorted.

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
    """Return a stage whose room and furniture hide a share of the object within `hidden`; None without any.

    The latents stay fixed: one of the rooms `layouts` is turned and shifted round the object.
    """
    number = int(rng.choice(layouts)) if layouts.start else int(rng.integers(layouts.stop))
    layout = library.plan(number).layout
    proposals = _Proposals(layout, actor, hidden[0] > 0, rng)
    for place in proposals.sift(rejected):
        support = int(proposals.support[place])

        def stage_at(slid: float, place: int = place, support: int = support) -> StagedRoom:
            origin, turn = proposals.pose(place, slid)
            zone = layout.supports[support].zone
            return StagedRoom.empty(library, actor, Room(number, support, zone, origin, turn, finishes))

        stage, slid = _hiding(stage_at, hidden)
        share = stage.hidden_share()
        if not hidden[0] <= share <= hidden[1]:
            rejected["place hides too much" if share > hidden[1] else "place hides too little"] += 1
        elif np.isinf(stage.behind).any():
            rejected["place open"] += 1  # beside a window, for example: nothing is behind the object
        elif layout.kind == EMPTY:
            return stage  # only the ground is near its camera
        elif (stage.behind < actor.nearest).mean() > MAX_NEAR or not proposals.is_free(place, slid):
            rejected["place near"] += 1
        else:
            return stage
    return None


def _hiding(stage_at: Callable[[float], StagedRoom], hidden: tuple[float, float]) -> tuple[StagedRoom, float]:
    """Return a stage moved out, by 0 to 1, from under things hiding too much of the object; and how much."""
    stage = stage_at(0.0)
    if hidden[0] == 0 or stage.hidden_share() <= hidden[1]:
        return stage, 0.0
    low, high = 0.0, 1.0
    for _ in range(5):
        slid = (low + high) / 2
        stage = stage_at(slid)
        share = stage.hidden_share()
        if hidden[0] <= share <= hidden[1]:
            break
        low, high = (slid, high) if share > hidden[1] else (low, slid)
    return stage, slid


class _Proposals:
    """Places in a layout: zones by the class's preference, any support in a zone, from the people's side.

    Attributes:
        support: (N,) number of each one's support.
        states: (N,) `PLACE_GOOD`, or the condition that it fails: constants of native code.
    """

    def __init__(self, layout: Layout, actor: Actor, hiding: bool, rng: np.random.Generator) -> None:
        """Draw places; `hiding`: whether good ones must have something before the object."""
        weights, supports = _support_table(layout, zone_weights(actor.object_class))
        self.fits_any = layout.kind in ("seamless", EMPTY) or bool(weights.any())  # these are for all things
        weights = weights if weights.any() else np.ones(len(supports))
        if hiding:
            weights = weights * np.where(supports[:, 1] < LOW_COVER, COVERED, 1.0)
        count = PROPOSALS[hiding]
        self.support = rng.choice(len(supports), count, p=weights / weights.sum())
        draws, clearance = rng.random((count, 5)), EYE_CLEARANCE * actor.small

        def propose(places: slice, slid: float) -> tuple[np.ndarray, np.ndarray]:
            proposed: tuple[np.ndarray, np.ndarray] = engine.propose_places(
                supports, self.support[places], draws[places],
                body=np.ascontiguousarray(actor.body.outline),
                outline=np.ascontiguousarray(layout.outline, np.float64),
                solids=_solid_table(layout),
                hiding=hiding,
                body_height=float(actor.body.heights[1]),
                eye=actor.view.eye,
                ahead=math.atan2(actor.ahead[1], actor.ahead[0]),
                slid=slid,
                clearance=clearance,
                # On the ground of an empty hall the camera may lie.
                lowest=0.0 if layout.kind == EMPTY else LOWEST_EYE * actor.small,
                highest=layout.height - clearance,
                edge=EDGE,
                near_ray=NEAR_RAY,
                wall_share=0.9,
            )  # fmt: skip
            return proposed

        self._propose = propose
        self.states, self._poses = propose(slice(None), 0.0)

    def sift(self, rejected: Counter[str]) -> list[int]:
        """Return numbers of the first good places; the others are counted by the condition that they fail."""
        small = engine.PLACE_TOO_SMALL
        state = self.states if self.fits_any else np.full(len(self.states), small)
        for lack, reason in ((small, "too small"), (engine.PLACE_EYE, "eye")):
            rejected[f"place {reason}"] += int(np.count_nonzero(state == lack))
        return np.flatnonzero(state == engine.PLACE_GOOD)[:16].tolist()

    def is_free(self, place: int, slid: float) -> bool:
        """Return whether the camera is free at one of the places that was free before it was slid."""
        if slid == 0:
            return True
        return int(self._propose(slice(place, place + 1), slid)[0][0]) != engine.PLACE_EYE

    def pose(self, place: int, slid: float) -> tuple[tuple[float, float, float], float]:
        """Return a layout's origin and turn in the world at one of the places, slid to the edge by 0 to 1."""
        turn, spot, slide = float(self._poses[place, 0]), self._poses[place, 1:4], self._poses[place, 4:]
        x, y, z = (-about_z(turn) @ (spot + slid * slide)).tolist()
        return (x, y, z), turn


@lru_cache(maxsize=256)
def _support_table(layout: Layout, places: tuple[tuple[str, float], ...]) -> tuple[np.ndarray, np.ndarray]:
    """Return the weight (N,) of each of a layout's supports, see `zone_weights`, and the supports as native
    code reads them (N, 8): turn, clearance, behind, half (2), centre (3).
    """
    zones, wanted = [support.zone for support in layout.supports], dict(places)
    weights = [wanted.get(zone, 0.0) / zones.count(zone) for zone in zones]
    rows = [(each.turn, each.clearance, each.behind, *each.half, *each.centre) for each in layout.supports]
    return np.array(weights), np.array(rows, np.float64).reshape(-1, 8)


@lru_cache(maxsize=256)
def _solid_table(layout: Layout) -> np.ndarray:
    """Return a layout's furniture (M, 14): outward normals and offsets of four sides, low and high."""
    if not len(layout.solids):
        return np.zeros((0, 14))
    corners = layout.solids[:, :4]
    way = np.roll(corners, -1, axis=1) - corners
    normal = np.stack([way[..., 1], -way[..., 0]], axis=2) / np.linalg.norm(way, axis=2, keepdims=True)
    sides = np.concatenate([normal, (normal * corners).sum(2, keepdims=True)], axis=2)
    return np.hstack([sides.reshape(-1, 12), layout.solids[:, 4]]).astype(np.float64)


def fits_seamless_ground(actor: Actor) -> bool:
    """Return whether some seamless ground may have a place for the object and its camera.

    False where the camera is in the ground or too high, sees over the wall behind the object, or where
    the ground is too near to it; none depends on the object's place.
    """
    view, height = actor.view, float(actor.view.eye[2])
    if not LOWEST_EYE * actor.small < height < unfurnished.HEIGHT - EYE_CLEARANCE * actor.small:
        return False
    camera = view.camera
    columns, rows = np.meshgrid(np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5)
    x, y = (columns - camera.cx) / camera.focal, (rows - camera.cy) / camera.focal
    rays = np.stack([x, y, np.ones_like(x)], axis=-1).reshape(-1, 3) @ view.rotation  # (N, 3) of depth 1
    surely = 0.01  # metres, and share of the frame, by which a view on a seamless ground must fail
    if (-rays[:, 2] * actor.nearest > height).mean() > MAX_NEAR + surely:
        return False
    level, towards = np.linalg.norm(rays[:, :2], axis=1), -view.eye[:2]
    along = rays[:, :2] @ towards / level
    beside = (towards @ towards - along**2).clip(0)
    way = along + np.sqrt((BEYOND**2 - beside).clip(0))  # at least, to the wall
    rises = (beside < BEYOND**2) & (rays[:, 2] >= 0)
    return not (rises & (height + way * rays[:, 2] / level > unfurnished.WALL + surely)).any()
