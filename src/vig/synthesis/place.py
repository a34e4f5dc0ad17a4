"""Where the object stands: a furnished room, one of its supports, a spot there, and from where it is seen."""

from __future__ import annotations

from collections import Counter

import numpy as np

from vig.synthesis.furniture import Support
from vig.synthesis.layouts import Layout
from vig.synthesis.library import Library
from vig.synthesis.spec import Room, Surface
from vig.synthesis.stage import NEAREST, Actor, Stage

ZONE_WEIGHTS = {
    "dining": 3.0, "drinks": 3.0, "cooking": 3.0, "display": 2.0, "desk": 1.5, "storage": 1.5, "reading": 1.0,
    "bedside": 1.0, "washing": 0.7, "floor": 0.3,
}  # fmt: skip
"""How often a teapot stands in each zone, relative to the number of supports there."""
PLACES_TRIED = 40
COVERED, LOW_COVER = 12.0, 0.7
"""Supports with less than so many metres above are so much more likely where they are to hide the object."""
EYE_CLEARANCE = 0.06
"""Metres between the eye and walls or furniture."""
EDGE = 0.01
"""Metres between the object's outline and the edge of what it stands on."""
WALL_SHARE = 0.9
"""Of supports with a wall or back behind, this share of views comes from the side of the people."""


def find_place(
    library: Library,
    actor: Actor,
    finishes: tuple[tuple[str, Surface], ...],
    hidden: tuple[float, float],
    rng: np.random.Generator,
    rejected: Counter[str],
) -> Stage | None:
    """A stage whose room and furniture hide a share of the object within `hidden`; None if none is found.

    The latents stay as they are: it is the room that is turned and shifted round the object.
    """
    number = int(rng.integers(library.layouts))
    layout = library.layout(number)
    weights = _weights(layout, hidden[0] > 0)
    for _ in range(PLACES_TRIED):
        chosen = int(rng.choice(len(weights), p=weights))
        support = layout.supports[chosen]
        reason, room = _stand(actor, support, hidden[0] > 0, rng)
        if room is None:
            rejected[f"place {reason}"] += 1
            continue
        described = Room(number, chosen, support.zone, *room, finishes)
        if not _eye_is_free(layout, described, actor):
            rejected["place eye"] += 1
            continue
        stage = Stage.empty(library, actor, described)
        share = stage.hidden()
        if not hidden[0] <= share <= hidden[1]:
            rejected["place hides too much" if share > hidden[1] else "place hides too little"] += 1
        elif (stage.behind < NEAREST).mean() > 0.02:
            rejected["place near"] += 1
        else:
            return stage
    return None


def _weights(layout: Layout, under_cover: bool) -> np.ndarray:
    """How likely the object is to stand on each support: a zone by `ZONE_WEIGHTS`, any support in it.

    under_cover: mostly on those with something above, which may hide it.
    """
    zones = [support.zone for support in layout.supports]
    weights = np.array([ZONE_WEIGHTS[zone] / zones.count(zone) for zone in zones])
    if under_cover:
        weights *= [COVERED if support.clearance < LOW_COVER else 1.0 for support in layout.supports]
    return weights / weights.sum()


def _stand(
    actor: Actor, support: Support, anywhere: bool, rng: np.random.Generator
) -> tuple[str, tuple[tuple[float, float, float], float] | None]:
    """Draw a view and a spot on a support: the layout's origin and turn in the world, or why not."""
    if actor.body.heights[1] > support.clearance - EDGE:
        return "clearance", None
    open_all_round = not np.isfinite(support.behind)
    spread = np.pi if anywhere or open_all_round or rng.uniform() > WALL_SHARE else 1.25
    # The eye is towards -`ahead`; people stand at -y of the support's axes.
    facing = np.arctan2(actor.ahead[1], actor.ahead[0]) - np.pi / 2 + rng.uniform(-spread, spread)
    x_axis = np.array([np.cos(facing), np.sin(facing)])
    y_axis = np.array([-x_axis[1], x_axis[0]])
    along = np.stack([actor.body.outline @ x_axis, actor.body.outline @ y_axis])
    low, high = along.min(1), along.max(1)
    half = np.array(support.half)
    least, most = -half + EDGE - low, half - EDGE - high  # where the object's origin can be, own axes
    if (least > most).any():
        return "too small", None
    spot = least + (most - least) * _spread(rng, most - least)
    turn = float(facing - support.turn)
    c, s = np.cos(support.turn), np.sin(support.turn)
    local = np.array(support.centre) + [c * spot[0] - s * spot[1], s * spot[0] + c * spot[1], 0.0]
    c, s = np.cos(turn), np.sin(turn)
    origin = (float(-(c * local[0] - s * local[1])), float(-(s * local[0] + c * local[1])), float(-local[2]))
    return "", (origin, turn)


def _spread(rng: np.random.Generator, room: np.ndarray) -> np.ndarray:
    """A spot in the unit square: near the side of the people on deep supports, anywhere along it."""
    reach = rng.uniform(0, min(1.0, 0.5 / max(room[1], 1e-6))) if rng.uniform() < 0.7 else rng.uniform()
    return np.array([rng.uniform(), reach])


def _eye_is_free(layout: Layout, room: Room, actor: Actor) -> bool:
    """Whether the eye is inside the room and outside its furniture."""
    eye = (actor.view.eye - np.array(room.origin)) @ room.rotation()
    if not 0.02 < eye[2] < layout.height - EYE_CLEARANCE:
        return False
    if not _inside(layout.outline, eye[:2], EYE_CLEARANCE):
        return False
    for solid in layout.solids:
        if solid[4, 0] - EYE_CLEARANCE < eye[2] < solid[4, 1] + EYE_CLEARANCE and _inside(
            solid[:4], eye[:2], -EYE_CLEARANCE
        ):
            return False
    return True


def _inside(outline: np.ndarray, point: np.ndarray, margin: float) -> bool:
    """Whether a point (2,) is in a polygon (N, 2), `margin` from its edges; grown if negative (convex)."""
    start, end = outline, np.roll(outline, -1, axis=0)
    way, offset = end - start, point - start
    if margin < 0:  # a convex solid: every edge has the point on its left, or is at most -margin away
        left = way[:, 0] * offset[:, 1] - way[:, 1] * offset[:, 0]
        return bool((left >= margin * np.linalg.norm(way, axis=1)).all())
    t = np.clip((offset * way).sum(1) / (way**2).sum(1), 0, 1)
    if np.linalg.norm(offset - t[:, None] * way, axis=1).min() < margin:
        return False
    crosses = (start[:, 1] > point[1]) != (end[:, 1] > point[1])
    at = start[:, 0] + way[:, 0] * (point[1] - start[:, 1]) / np.where(crosses, way[:, 1], 1.0)
    return bool((crosses & (at > point[0])).sum() % 2)
