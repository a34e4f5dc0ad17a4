"""Ways to occlude an object: something in front of it, a hand, a branch, as a last resort a board."""

from bisect import bisect
from collections.abc import Callable, Container, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import accumulate

import numpy as np

from vig_native import engine
from vig_world.composition.stage import StagedRoom
from vig_world.dataset.spec import Placed, Role
from vig_world.library import ALL_ZONES
from vig_world.rotations import vector_of


@dataclass(frozen=True)
class OccluderCandidate:
    """Props that move together along a line: at offset `least` they hide most, at `most` little or nothing.

    Attributes:
        parts: The props at offset 0.
        motion: (3,) metres per unit of offset, across the line of sight.
        least: Lowest offset at which the props are above the support, on it if they stand, and the hand that
            holds them is in the frame.
        most: Highest such offset.
        stands: Whether they stand on the object's own support; otherwise they are held in mid-air.
        front: Their least coordinate along the direction of view, metres, at offset 0.
        bound: Share of the object that is hidden at most at the least offset.
    """

    parts: list[Placed]
    motion: np.ndarray
    least: float
    most: float
    stands: bool
    front: float
    bound: float


Kind = Callable[[StagedRoom, np.random.Generator, float], OccluderCandidate | None]
"""Draws a candidate that may hide the share of the object given last; None when no draw is promising."""
DRAWS = 12
PROPS, TURNS = 3, 5
"""Number of props, and of orientations of each, considered at a time to stand before the object."""


def draw_kind(
    stage: StagedRoom,
    rng: np.random.Generator,
    level: float,
    last_resort: bool,
    hopeless: Container[Kind] = (),
) -> Kind | None:
    """Draw a way to hide the object that suits the elevation and the share to be hidden.

    Standing props hide little from above; an arm or a twig never hides nearly everything. None when all
    suitable kinds are `hopeless`.
    """
    high = float(np.clip((stage.actor.elevation - 0.45) / 0.6, 0, 1))
    missing = level - stage.hidden_share()
    chances: dict[Kind, float] = {
        standing: 0.85 - 0.8 * high,
        in_hand: 0.08 + 0.42 * high,
        reaching: (0.06 + 0.2 * high) * (missing < 0.65),
        branch: (0.02 + 0.02 * high) * (missing < 0.45),
        board: 0.3 * last_resort,
    }
    kinds = [kind for kind, chance in chances.items() if chance > 0 and kind not in hopeless]
    if not kinds:
        return None
    ends = list(accumulate(chances[kind] for kind in kinds))
    return kinds[min(bisect(ends, rng.random() * ends[-1]), len(kinds) - 1)]


def draw_large(
    stage: StagedRoom, rng: np.random.Generator, areas: tuple[float, float], upright: bool
) -> tuple[str, int]:
    """Draw a prop whose broadest side is within `areas`, or the last one drawn.

    First from the zone of the object's support, then from any.

    Args:
        areas: Least and greatest area, square metres.
        upright: Whether it is seen from the side.
    """
    library = stage.library
    for draw, (zone_at, family_at, member_at) in enumerate(rng.random((DRAWS, 3)).tolist()):
        zone = stage.room.zone if draw < DRAWS // 2 else ALL_ZONES[int(zone_at * len(ALL_ZONES))]
        families = stage.families(zone)
        family = families[int(family_at * len(families))]
        name = stage.member(family, int(member_at * library.members(family)))
        x, y, z = library.sizes(*name)
        area = z * max(x, y) if upright else x * y * z / min(x, y, z)
        if areas[0] <= area <= areas[1]:
            break
    return name


def area_to_hide(stage: StagedRoom, level: float, nearness: float) -> float:
    """Return the area, m^2, of a silhouette, `nearness` of the object's distance away, that hides `level`."""
    view = stage.actor.view
    pixels = (level - stage.hidden_share()) * len(stage.actor.pixels)
    return pixels * (nearness * float(stage.actor.own.mean()) / view.camera.focal) ** 2


def place_prop(
    name: tuple[str, int], position: np.ndarray, rotation: np.ndarray, role: Role = "occluder"
) -> Placed:
    """Return a prop at (3,) turned by (3, 3), as plain data."""
    x, y, z = np.asarray(position, float).tolist()
    return Placed(name[0], name[1], (x, y, z), vector_of(rotation), role)


def standing(stage: StagedRoom, rng: np.random.Generator, level: float) -> OccluderCandidate | None:
    """Return a prop on the same support, between the camera and the object; moves sideways."""
    least_area = area_to_hide(stage, level, 0.7)
    names = [draw_large(stage, rng, (least_area, np.inf), True) for _ in range(PROPS)]
    return _draw_candidate(stage, "standing", level, names, rng.random((PROPS * TURNS, 3)))


def in_hand(stage: StagedRoom, rng: np.random.Generator, level: float) -> OccluderCandidate | None:
    """Return a prop held by an arm from outside the frame: tilted, or its broad side to the camera."""
    scale, least_area = stage.actor.scale, area_to_hide(stage, level, 0.75)
    # At most .008 square metres larger than the part that it hides, for a teapot, to stay near the object.
    name = draw_large(stage, rng, (least_area, least_area + 0.008 * scale**2), False)
    grasps = 6  # number of draws for a held prop to have room before the object with the hand in the frame
    numbers = rng.integers(stage.library.members("arm"), size=grasps).tolist()
    arms = [stage.member("arm", number) for number in numbers]
    draws = rng.random((grasps, 7)), rng.standard_normal((grasps, 3))
    return _draw_candidate(stage, "in hand", level, [name], *draws, ends=(0.0, 0.4 * scale), arms=arms)


def _draw_fixture(
    stage: StagedRoom, rng: np.random.Generator, level: float, kind: str, ends: tuple[float, float]
) -> OccluderCandidate | None:
    """Return a fixture that reaches into the frame; `ends` of its offset are over the object's scale."""
    name = stage.member(kind, int(rng.integers(stage.library.members("arm"))))
    scale, draws = stage.actor.scale, (rng.random((1, 7)), rng.standard_normal((1, 3)))
    return _draw_candidate(stage, kind, level, [name], *draws, ends=(ends[0] * scale, ends[1] * scale))


reaching = partial(_draw_fixture, kind="arm", ends=(-0.2, 0.3))  # a bare hand and its arm before the object
branch = partial(_draw_fixture, kind="twig", ends=(-0.3, 0.2))  # a leafy twig that reaches into the frame
board = partial(_draw_fixture, kind="board", ends=(-0.3, 0.3))
"""The end of a board: level above the object, as of a shelf, or its broad side to the camera."""


def _draw_candidate(
    stage: StagedRoom,
    kind: str,
    level: float,
    names: list[tuple[str, int]],
    uniform: np.ndarray,
    normal: np.ndarray | None = None,
    ends: tuple[float, float] = (0.0, 0.0),
    arms: Sequence[tuple[str, int]] = (),
) -> OccluderCandidate | None:
    """Return the first of N draws that has room before the object; see `occluder.cc`.

    Args:
        stage: The room and the object.
        kind: Name of the kind in native code.
        level: Share of the object that is to be hidden.
        names: The props, in turn one for each draw.
        uniform: (N, 3) in [0, 1) for `standing`, else (N, 7).
        normal: (N, 3) standard normal numbers, for occluders in mid-air.
        ends: Bounds of the offset of occluders in mid-air.
        arms: N arms that hold it, if any.
    """
    library = stage.library
    points = np.stack([library.extremes(*name) for name in names])
    hands = np.stack([library.extremes(*arm) for arm in arms]) if arms else np.zeros((0, 0, 3))
    thin = int(library.sizes(*names[0]).argmin())
    normal = np.zeros((0, 3)) if normal is None else normal
    drawn = engine.draw_occluder(
        stage.native, kind, uniform, normal, points, hands, thin, level, stage.hidden_share(), ends
    )
    if drawn is None:
        return None
    number, rows, least, most, front, bound = drawn
    position, hand_position, motion = rows[6:]
    parts = [place_prop(names[number % len(names)], position, rows[:3])]
    if arms:
        parts.append(place_prop(arms[number], hand_position, rows[3:6], "holder"))
    return OccluderCandidate(parts, motion, least, most, kind == "standing", front, bound)
