"""Ways to occlude an object: something in front of it, a hand, a branch, as a last resort a board."""

from __future__ import annotations

from collections.abc import Callable, Container
from dataclasses import dataclass

import numpy as np

from vig_world.composition.stage import StagedRoom
from vig_world.dataset.spec import Placed, Role
from vig_world.library import ALL_ZONES
from vig_world.rotations import about_x, about_z, along, turned_about_z, vector_of


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
    """

    parts: list[Placed]
    motion: np.ndarray
    least: float
    most: float
    stands: bool


Kind = Callable[[StagedRoom, np.random.Generator, float], OccluderCandidate | None]
"""Draws a candidate that may hide the share of the object given last; None when no draw is promising."""
DRAWS = 12
PROPS, TURNS = 3, 5
"""Number of props, and of orientations of each, considered at a time to stand before the object."""
GRASPS = 6
"""Number of draws for a held prop to have room before the object with the hand in the frame."""
MORE_THAN_HIDES = 0.008
"""Square metres by which a held prop may exceed the area it is to hide: it stays near the object. For a
teapot; like other lengths here it scales with the object."""
HAND_INSIDE = 6
"""Least distance of holding fingertips from the edge of the layout's frame, pixels."""


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
    missing = level - stage.hidden()
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
    weights = np.array([chances[kind] for kind in kinds])
    return kinds[int(rng.choice(len(kinds), p=weights / weights.sum()))]


def draw_prop(stage: StagedRoom, rng: np.random.Generator, zone: str) -> tuple[str, int]:
    """A random prop that belongs in a zone: its family and number."""
    families = stage.families(zone)
    family = families[int(rng.integers(len(families)))]
    return family, int(rng.integers(stage.library.members(family)))


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
    """Square metres of a silhouette, `nearness` of the object's distance away, that can hide `level`."""
    view = stage.actor.view
    pixels = (level - stage.hidden()) * len(stage.actor.pixels)
    return pixels * (nearness * float(stage.actor.own.mean()) / view.camera.focal) ** 2


def placed(
    name: tuple[str, int], position: np.ndarray, rotation: np.ndarray, role: Role = "occluder"
) -> Placed:
    """A prop at (3,) turned by (3, 3), as plain data."""
    x, y, z = np.asarray(position, float).tolist()
    return Placed(name[0], name[1], (x, y, z), vector_of(rotation), role)


def standing(stage: StagedRoom, rng: np.random.Generator, level: float) -> OccluderCandidate | None:
    """A prop on the same support, between the camera and the object; moves sideways."""
    ahead, least_area = stage.actor.ahead, area_to_hide(stage, level, 0.7)
    names = [draw_large(stage, rng, (least_area, np.inf), True) for _ in range(PROPS)]
    count = PROPS * TURNS
    angles = rng.uniform(0, 2 * np.pi, count)
    gap = stage.margin + 0.002 * 0.5**stage.halvings
    gaps = gap + rng.uniform(0, 0.1 * stage.actor.scale, count) * np.cos(stage.actor.elevation)
    motions = rng.choice([-1.0, 1.0], count)[:, None] * stage.actor.aside
    clouds = np.tile(np.stack([stage.library.extremes(*name) for name in names]), (TURNS, 1, 1))
    clouds = turned_about_z(clouds, angles)
    distances = (stage.actor.body.outline @ -ahead[:2]).max() + (clouds @ ahead).max(1) + gaps
    clouds -= distances[:, None, None] * ahead
    least, most = stage.carried(stage.support, clouds, motions)
    least, most = np.maximum(least, 0.0), np.minimum(most, 0.5 * stage.actor.scale)
    view = stage.actor.view
    hopeful = (least < most) & ((clouds @ view.forward).min(1) >= view.forward @ view.eye + stage.nearest)
    numbers = np.flatnonzero(hopeful)
    at_least = clouds[numbers] + (least[numbers, None] * motions[numbers])[:, None]
    numbers = numbers[stage.hidden_at_most(at_least) >= level]
    if not len(numbers):
        return None
    chosen = int(numbers[0])
    part = placed(names[chosen % PROPS], -distances[chosen] * ahead, about_z(float(angles[chosen])))
    return OccluderCandidate([part], motions[chosen], float(least[chosen]), float(most[chosen]), True)


def in_hand(stage: StagedRoom, rng: np.random.Generator, level: float) -> OccluderCandidate | None:
    """A prop held by an arm that comes from outside the frame: tilted, or its broad side to the camera."""
    least_area = area_to_hide(stage, level, 0.75)
    name = draw_large(stage, rng, (least_area, least_area + MORE_THAN_HIDES * stage.actor.scale**2), False)
    hull = stage.library.extremes(*name)
    for _ in range(GRASPS):
        if rng.uniform() < 0.3 + 0.7 * level:
            turn = _facing(stage, rng, int(stage.library.sizes(*name).argmin()))
        else:
            turn = about_z(rng.uniform(0, 6.3)) @ about_x(rng.uniform(0, 1.2)) @ about_z(rng.uniform(0, 6.3))
        points = hull @ turn.T
        middle = (points.max(0) + points.min(0)) / 2
        points -= middle
        outward = _outward(stage, rng)
        arm, hand = _arm(stage, rng, outward)
        aim = _aim(stage, rng, np.concatenate([points, hand]))
        if aim is None:
            continue
        fingertips = aim + 0.75 * (points @ outward).max() * outward
        lowest = min(aim[2] + points[:, 2].min(), fingertips[2] + hand[:, 2].min())
        most = min(0.4 * stage.actor.scale, _until_hand_is_out(stage, fingertips, outward))
        parts = [placed(name, aim - middle, turn), placed(arm[0], fingertips, arm[1], "holder")]
        if candidate := _held(parts, lowest, outward, 0.0, most, stage.margin):
            return candidate
    return None


def _held(
    parts: list[Placed], lowest: float, motion: np.ndarray, least: float, most: float, margin: float
) -> OccluderCandidate | None:
    """A candidate in mid-air, `lowest` at offset 0; None where all of its path is below the support."""
    to_support, rise = lowest - margin, float(motion[2])
    if rise < 0:
        most = min(most, -to_support / rise)
    elif rise > 0:
        least = max(least, -to_support / rise)
    return (
        OccluderCandidate(parts, motion, least, most, False)
        if least < most and (rise or to_support >= 0)
        else None
    )


def _until_hand_is_out(stage: StagedRoom, fingertips: np.ndarray, outward: np.ndarray) -> float:
    """How far a point (3,) can move along a direction (3,) in the image plane inside the frame's margin."""
    view = stage.actor.view
    place = (view.rotation @ fingertips + view.translation).tolist()
    ends = []
    for coordinate, way, middle, size in zip(
        place[:2],
        (view.rotation[:2] @ outward).tolist(),
        (view.camera.cx, view.camera.cy),
        (view.camera.width, view.camera.height),
        strict=True,
    ):
        scale = view.camera.focal / place[2]
        pixel, speed = scale * coordinate + middle, scale * way
        if not HAND_INSIDE <= pixel <= size - HAND_INSIDE:
            return -1.0
        room = size - HAND_INSIDE - pixel if speed > 0 else pixel - HAND_INSIDE
        ends.append(room / max(abs(speed), 1e-9))
    return min(ends)


def reaching(stage: StagedRoom, rng: np.random.Generator, level: float) -> OccluderCandidate | None:
    """A bare hand and its arm before the object."""
    outward = _outward(stage, rng)
    arm, hand = _arm(stage, rng, outward)
    aim = _aim(stage, rng, hand)
    if aim is None:
        return None
    lowest, scale = float(aim[2] + hand[:, 2].min()), stage.actor.scale
    return _held([placed(arm[0], aim, arm[1])], lowest, outward, -0.2 * scale, 0.3 * scale, stage.margin)


def branch(stage: StagedRoom, rng: np.random.Generator, level: float) -> OccluderCandidate | None:
    """A leafy twig that reaches into the frame."""
    outward = _outward(stage, rng)
    twig = _fixture(stage, rng, "twig")
    rotation = along(outward, stage.actor.view.forward) @ about_x(rng.normal(0, 0.3))
    points = stage.library.extremes(*twig) @ rotation.T
    aim = _aim(stage, rng, points)
    if aim is None:
        return None
    lowest, scale = float(aim[2] + points[:, 2].min()), stage.actor.scale
    return _held([placed(twig, aim, rotation)], lowest, outward, -0.3 * scale, 0.2 * scale, stage.margin)


def board(stage: StagedRoom, rng: np.random.Generator, level: float) -> OccluderCandidate | None:
    """The end of a board: level above the object, as of a shelf, or its broad side to the camera."""
    if rng.uniform() < 0.5:
        turn = rng.uniform(-0.3, np.pi + 0.3)
        outward = np.cos(turn) * stage.actor.aside + np.sin(turn) * stage.actor.ahead
        rotation = about_z(np.arctan2(outward[1], outward[0]))
    else:
        outward = _outward(stage, rng)
        rotation = along(outward, stage.actor.view.forward) @ about_x(rng.normal(0, 0.2))
    end = _fixture(stage, rng, "board")
    points = stage.library.extremes(*end) @ rotation.T
    aim = _aim(stage, rng, points)
    if aim is None:
        return None
    lowest, scale = float(aim[2] + points[:, 2].min()), stage.actor.scale
    return _held([placed(end, aim, rotation)], lowest, outward, -0.3 * scale, 0.3 * scale, stage.margin)


def _fixture(stage: StagedRoom, rng: np.random.Generator, family: str) -> tuple[str, int]:
    return stage.member(family, int(rng.integers(stage.library.members("arm"))))


def _arm(
    stage: StagedRoom, rng: np.random.Generator, outward: np.ndarray
) -> tuple[tuple[tuple[str, int], np.ndarray], np.ndarray]:
    """An arm's name and rotation (3, 3), and its farthest points (N, 3) from the fingertips."""
    name = _fixture(stage, rng, "arm")
    rotation = along(outward, stage.actor.view.forward) @ about_x(rng.uniform(0, 6.3))
    return (name, rotation), stage.library.extremes(*name) @ rotation.T


def _facing(stage: StagedRoom, rng: np.random.Generator, axis: int) -> np.ndarray:
    """A rotation that takes a prop's `axis` nearly to the direction of view, with any roll."""
    to_x = np.eye(3)[[axis, (axis + 1) % 3, (axis + 2) % 3]]
    tilt = about_z(rng.normal(0, 0.25)) @ about_x(rng.uniform(0, 2 * np.pi))
    return along(stage.actor.view.forward, _outward(stage, rng)) @ tilt @ to_x


def _aim(stage: StagedRoom, rng: np.random.Generator, points: np.ndarray) -> np.ndarray | None:
    """A point (3,) on a ray to the object's middle, so that points (N, 3) from there are before the object.

    None when there is no room for them between camera and object.
    """
    view, (row, column) = stage.actor.view, stage.actor.middle
    extent = points @ view.forward
    nearest = stage.nearest - float(extent.min())
    farthest = stage.actor.body.depths[0] - float(view.forward @ view.eye) - float(extent.max())
    farthest -= 2 * stage.margin
    if nearest > farthest:
        return None
    depth, aside, below = rng.uniform(nearest, farthest), rng.normal(0, 2), rng.normal(0, 2)
    if stage.closer:
        depth = nearest * (farthest / nearest) ** ((depth - nearest) / max(farthest - nearest, 1e-9))
    x = (column + aside - view.camera.cx) / view.camera.focal
    y = (row + below - view.camera.cy) / view.camera.focal
    return view.eye + depth * (np.array([x, y, 1.0]) @ view.rotation)


def _outward(stage: StagedRoom, rng: np.random.Generator) -> np.ndarray:
    """A random unit vector (3,) in the image plane."""
    angle = rng.uniform(0, 2 * np.pi)
    return np.cos(angle) * stage.actor.view.rotation[0] + np.sin(angle) * stage.actor.view.rotation[1]
