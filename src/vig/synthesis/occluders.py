"""Ways to hide an object: something in front of it, a hand, a branch, something that hangs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

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


def draw_kind(stage: Stage, rng: np.random.Generator) -> Kind:
    """A way to hide the object that suits the elevation: what stands hides little from above."""
    high = float(np.clip((stage.actor.elevation - 0.6) / 0.7, 0, 1))
    chances: dict[Kind, float] = {
        standing: 0.85 - 0.75 * high,
        in_hand: 0.08 + 0.42 * high,
        reaching: 0.06 + 0.2 * high,
        branch: 0.05 + 0.07 * high,
        hanging: 0.03 * (stage.actor.elevation < 0.7),
    }
    kinds, weights = list(chances), np.array(list(chances.values()))
    return kinds[int(rng.choice(len(kinds), p=weights / weights.sum()))]


def draw_prop(
    stage: Stage, rng: np.random.Generator, zone: str, least_area: float = 0.0
) -> tuple[str, int]:
    """A random prop that belongs in a zone: its family and number.

    Up to twelve are drawn until one has a silhouette of `least_area` square metres from the side.
    """
    families = stage.library.families(zone)
    for _ in range(DRAWS):
        family = families[int(rng.integers(len(families)))]
        number = int(rng.integers(stage.library.members(family)))
        if not least_area or stage.library.area(family, number) >= least_area:
            break
    return family, number


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
    name = draw_prop(stage, rng, stage.room.zone, area_to_hide(stage, level, 0.7))
    turn = about_z(rng.uniform(0, 2 * np.pi))
    points = stage.library.extremes(*name) @ turn.T
    gap = MARGIN + 0.002 + rng.uniform(0, 0.1) * np.cos(stage.actor.elevation)
    ahead = stage.actor.ahead
    distance = (stage.actor.body.outline @ -ahead[:2]).max() + (points @ ahead).max() + gap
    part = placed(name, -distance * ahead, turn)
    return Candidate([part], rng.choice([-1.0, 1.0]) * stage.actor.aside, 0.0, 0.5, True)


def in_hand(stage: Stage, rng: np.random.Generator, level: float) -> Candidate:
    """A tilted prop held by an arm that comes from outside the frame."""
    name = draw_prop(stage, rng, stage.room.zone, area_to_hide(stage, level, 0.5))
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


def hanging(stage: Stage, rng: np.random.Generator, level: float) -> Candidate:
    """An upright prop on a cord; moves sideways."""
    name = draw_prop(stage, rng, stage.room.zone, area_to_hide(stage, level, 0.5))
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
