"""Ways to hide an object: something in front of it, a hand, a branch, something that hangs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from vig.synthesis.library import ALL_ZONES
from vig.synthesis.rotations import about_x, about_z, along, vector_of
from vig.synthesis.spec import Placed, Role
from vig.synthesis.stage import MARGIN, NEAREST, Stage


@dataclass(frozen=True)
class Candidate:
    """Props that move together along a line: at offset `least` they hide most, at `most` nothing.

    motion: (3,) metres per unit of offset. stands: on the object's own support; otherwise in mid-air, held.
    """

    parts: list[Placed]
    motion: np.ndarray
    least: float
    most: float
    stands: bool


Kind = Callable[[Stage, np.random.Generator, float], Candidate]
"""Draws a candidate that may hide a share of the object, given last."""
DRAWS = 12


def draw_kind(stage: Stage, rng: np.random.Generator, last_resort: bool) -> Kind:
    """A way to hide the object that suits the elevation: what stands hides little from above."""
    high = float(np.clip((stage.actor.elevation - 0.6) / 0.7, 0, 1))
    chances: dict[Kind, float] = {
        standing: 0.85 - 0.75 * high,
        in_hand: 0.08 + 0.42 * high,
        reaching: 0.06 + 0.2 * high,
        branch: 0.05 + 0.07 * high,
        hanging: 0.03 * (stage.actor.elevation < 0.7),
        board: 0.3 * last_resort,
    }
    kinds, weights = list(chances), np.array(list(chances.values()))
    return kinds[int(rng.choice(len(kinds), p=weights / weights.sum()))]


def draw_prop(stage: Stage, rng: np.random.Generator, zone: str) -> tuple[str, int]:
    """A random prop that belongs in a zone: its family and number."""
    families = stage.library.families(zone)
    family = families[int(rng.integers(len(families)))]
    return family, int(rng.integers(stage.library.members(family)))


def draw_large(stage: Stage, rng: np.random.Generator, least_area: float, upright: bool) -> tuple[str, int]:
    """A random prop of at least `least_area` square metres from its broadest side, or the last drawn.

    First from the zone of the object's support, then from any. upright: it is seen from the side.
    """
    for draw in range(DRAWS):
        zone = stage.room.zone if draw < DRAWS // 2 else ALL_ZONES[int(rng.integers(len(ALL_ZONES)))]
        name = draw_prop(stage, rng, zone)
        x, y, z = stage.library.sizes(*name)
        area = z * max(x, y) if upright else x * y * z / min(x, y, z)
        if area >= least_area:
            break
    return name


def area_to_hide(stage: Stage, level: float, nearness: float) -> float:
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


def standing(stage: Stage, rng: np.random.Generator, level: float) -> Candidate:
    """A prop on the same support, between the eye and the object; moves sideways."""
    name = draw_large(stage, rng, area_to_hide(stage, level, 0.7), True)
    turn = about_z(rng.uniform(0, 2 * np.pi))
    points = stage.library.extremes(*name) @ turn.T
    gap = MARGIN + 0.002 + rng.uniform(0, 0.1) * np.cos(stage.actor.elevation)
    ahead = stage.actor.ahead
    distance = (stage.actor.body.outline @ -ahead[:2]).max() + (points @ ahead).max() + gap
    part = placed(name, -distance * ahead, turn)
    return Candidate([part], rng.choice([-1.0, 1.0]) * stage.actor.aside, 0.0, 0.5, True)


def in_hand(stage: Stage, rng: np.random.Generator, level: float) -> Candidate:
    """A prop held by an arm that comes from outside the frame: tilted, or its broad side to the eye."""
    name = draw_large(stage, rng, area_to_hide(stage, level, 0.5), False)
    if rng.uniform() < level:
        turn = _facing(stage, rng, int(stage.library.sizes(*name).argmin()))
    else:
        turn = about_z(rng.uniform(0, 6.3)) @ about_x(rng.uniform(0, 1.2)) @ about_z(rng.uniform(0, 6.3))
    points = stage.library.extremes(*name) @ turn.T
    middle = (points.max(0) + points.min(0)) / 2
    depth = points @ stage.actor.view.forward
    outward = _outward(stage, rng)
    aim = _aim(stage, rng, (depth.max() - depth.min()) / 2)
    grip = 0.75 * ((points - middle) @ outward).max()
    arm = _arm(stage, rng, aim + grip * outward, outward, "holder")
    return Candidate([placed(name, aim - middle, turn), arm], outward, -0.06, 0.4, False)


def reaching(stage: Stage, rng: np.random.Generator, level: float) -> Candidate:
    """A bare hand and its arm before the object."""
    outward = _outward(stage, rng)
    return Candidate(
        [_arm(stage, rng, _aim(stage, rng, 0.04), outward, "occluder")], outward, -0.2, 0.3, False
    )


def branch(stage: Stage, rng: np.random.Generator, level: float) -> Candidate:
    """A leafy twig that reaches into the frame."""
    outward = _outward(stage, rng)
    twig = ("twig", _member(stage, rng))
    rotation = along(outward, stage.actor.view.forward) @ about_x(rng.normal(0, 0.3))
    return Candidate([placed(twig, _aim(stage, rng, 0.03), rotation)], outward, -0.3, 0.2, False)


def board(stage: Stage, rng: np.random.Generator, level: float) -> Candidate:
    """The end of a shelf board above the object."""
    turn = rng.uniform(-0.3, np.pi + 0.3)
    outward = np.cos(turn) * stage.actor.aside + np.sin(turn) * stage.actor.ahead
    rotation = about_z(np.arctan2(outward[1], outward[0]))
    part = placed(("board", _member(stage, rng)), _aim(stage, rng, 0.06), rotation)
    return Candidate([part], outward, -0.3, 0.3, False)


def hanging(stage: Stage, rng: np.random.Generator, level: float) -> Candidate:
    """An upright prop on a cord; moves sideways."""
    name = draw_large(stage, rng, area_to_hide(stage, level, 0.5), True)
    turn = about_z(rng.uniform(0, 2 * np.pi))
    points = stage.library.extremes(*name) @ turn.T
    depth = points @ stage.actor.view.forward
    middle = (points.max(0) + points.min(0)) / 2
    aim = _aim(stage, rng, (depth.max() - depth.min()) / 2)
    top = aim + np.array([0.0, 0.0, np.ptp(points[:, 2]) / 2 - 0.002])
    cord = placed(("cord", _member(stage, rng)), top, np.eye(3), "holder")
    parts = [placed(name, aim - middle, turn), cord]
    return Candidate(parts, rng.choice([-1.0, 1.0]) * stage.actor.aside, 0.0, 0.4, False)


def _member(stage: Stage, rng: np.random.Generator) -> int:
    return int(rng.integers(stage.library.members("arm")))


def _arm(
    stage: Stage, rng: np.random.Generator, fingertips: np.ndarray, outward: np.ndarray, role: Role
) -> Placed:
    rotation = along(outward, stage.actor.view.forward) @ about_x(rng.uniform(0, 6.3))
    return placed(("arm", _member(stage, rng)), fingertips, rotation, role)


def _facing(stage: Stage, rng: np.random.Generator, axis: int) -> np.ndarray:
    """A rotation that takes a prop's `axis` nearly to the direction of view, with any roll."""
    to_x = np.eye(3)[[axis, (axis + 1) % 3, (axis + 2) % 3]]
    tilt = about_z(rng.normal(0, 0.25)) @ about_x(rng.uniform(0, 2 * np.pi))
    return along(stage.actor.view.forward, _outward(stage, rng)) @ tilt @ to_x


def _aim(stage: Stage, rng: np.random.Generator, half_depth: float) -> np.ndarray:
    """A point (3,) on the ray to the object's middle, nearer than the object by more than `half_depth`."""
    view, seen = stage.actor.view, np.isfinite(stage.actor.depth)
    free = stage.actor.body.depths[0] - view.forward @ view.eye - half_depth - 2 * MARGIN
    nearest = NEAREST + half_depth
    depth = rng.uniform(min(nearest, free), max(free, nearest))
    rows, columns = np.nonzero(seen)
    x = (columns.mean() + 0.5 + rng.normal(0, 2) - view.camera.cx) / view.camera.focal
    y = (rows.mean() + 0.5 + rng.normal(0, 2) - view.camera.cy) / view.camera.focal
    return view.eye + view.rotation.T @ (depth * np.array([x, y, 1.0]))


def _outward(stage: Stage, rng: np.random.Generator) -> np.ndarray:
    """A random unit vector (3,) in the image plane."""
    angle = rng.uniform(0, 2 * np.pi)
    return np.cos(angle) * stage.actor.view.rotation[0] + np.sin(angle) * stage.actor.view.rotation[1]
