"""Strews props over the supports, near the object and in the background, hiding nothing of it."""

from __future__ import annotations

from collections import Counter

import numpy as np

from vig.synthesis.footprint import Footprint
from vig.synthesis.furniture import Support
from vig.synthesis.occluders import draw_prop, placed
from vig.synthesis.rotations import about_z
from vig.synthesis.spec import Placed
from vig.synthesis.stage import MARGIN, Stage

MOST_COVER = 0.3
"""The window of a single piece of clutter covers no more of the frame than this."""
FAR = 4.5
"""Metres from the eye beyond which supports are left empty."""
BACKGROUND = 4
"""Supports besides the object's own that are strewn."""


def strew(stage: Stage, rng: np.random.Generator, rejected: Counter[str]) -> None:
    """Stand clutter on the object's own support round the object, and on others in view."""
    wanted = int(rng.integers(2, 9))
    near, far = visible_ground(stage)
    for _ in range(2 * wanted):
        if wanted == 0:
            break
        ahead = rng.uniform(near, far)
        aside = rng.uniform(-1, 1) * (0.45 * (ahead - near) + 0.25)
        spot = ahead * stage.actor.ahead + aside * stage.actor.aside
        wanted -= _try(stage, rng, stage.support, spot, rejected)
    for support in _in_background(stage, rng):
        half = np.array(support.half)
        for _ in range(rng.integers(1, 6)):
            x, y = rng.uniform(-half, half)
            spot = stage.from_support(support, np.array([x, y, 0.0]))
            _try(stage, rng, support, spot, rejected)


def visible_ground(stage: Stage) -> tuple[float, float]:
    """Nearest and farthest ground in the frame: metres ahead of the object's axis, at most 1.3."""
    view = stage.actor.view
    height, back = view.eye[2], float(view.eye @ stage.actor.ahead)
    half = np.arctan(view.camera.height / 2 / view.camera.focal)
    steep, shallow = stage.actor.elevation + half, stage.actor.elevation - half
    near = back + height / np.tan(steep)
    far = back + height / np.tan(shallow) if shallow > 0.05 else np.inf
    return near, float(min(far + 0.05, 1.3))


def _in_background(stage: Stage, rng: np.random.Generator) -> list[Support]:
    """Up to four other supports whose middle is in front of the eye and not too far, in random order."""
    supports = stage.library.layout(stage.room.layout).supports
    middles = stage.room.to_world(np.array([support.centre for support in supports]))
    x, y, z = ((middles - stage.actor.view.eye) @ stage.actor.view.rotation.T).T
    seen = (z > 0.3) & (z < FAR) & (np.abs(x) < 0.8 * z + 0.3) & (np.abs(y) < 0.8 * z + 0.3)
    seen[stage.room.support] = False
    chosen = rng.permutation(np.nonzero(seen)[0])[:BACKGROUND]
    return [supports[number] for number in chosen if supports[number].zone != "floor"]


def _try(
    stage: Stage, rng: np.random.Generator, support: Support, spot: np.ndarray, rejected: Counter[str]
) -> bool:
    """Stand a prop on a support, as near to a spot (3,) as its edges allow, or count why it cannot be.

    Half of the props are square to the support's edges.
    """
    name = draw_prop(stage, rng, support.zone)
    square = support.turn + stage.room.turn + rng.choice([0.0, np.pi, np.pi / 2]) + rng.normal(0, 0.08)
    turn = about_z(square if rng.uniform() < 0.5 else rng.uniform(0, 2 * np.pi))
    own = stage.on_support(support, spot[None])[0]
    reach = np.abs(stage.on_support(support, stage.library.extremes(*name) @ turn.T + spot)[:, :2] - own[:2])
    free = np.array(support.half) - reach.max(axis=0) - 2 * MARGIN
    if (free < 0).any():
        rejected["clutter too large"] += 1
        return False
    own[:2] = np.clip(own[:2], -free, free)
    own[2] = 0.0
    part = placed(name, stage.from_support(support, own), turn, "clutter")
    reason = _obstacle(stage, support, part)
    if reason:
        rejected[f"clutter {reason}"] += 1
    return not reason


def _obstacle(stage: Stage, support: Support, part: Placed) -> str:
    view = stage.actor.view
    points = stage.points(part)
    if not stage.carries(support, points):
        return "off support"
    footprint = Footprint.of(points, view.forward)
    if reason := stage.check(footprint):
        return reason
    rows, columns = view.window(points)
    cover = (rows.stop - rows.start) * (columns.stop - columns.start) / stage.actor.depth.size
    if cover == 0 or cover > MOST_COVER:
        return "unseen" if cover == 0 else "too large"
    seen = None
    near = footprint.depths[0] < stage.actor.body.depths[1]
    if near and np.isfinite(stage.actor.depth[rows, columns]).any():
        seen = stage.seen_at([part])
        if stage.hidden(seen) > stage.hidden():
            return "hides the object"
    stage.add([part], [footprint], seen)
    return ""
