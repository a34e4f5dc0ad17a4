"""Places props between the camera and the object so that a chosen share of it is hidden."""

from collections import Counter

import numpy as np

from vig_world.assets.footprint import Footprint
from vig_world.composition.occluders import Kind, OccluderCandidate, draw_kind
from vig_world.composition.stage import StagedRoom

FIT_TOLERANCE = 0.008


def hide(
    stage: StagedRoom, target: float, rng: np.random.Generator, rejected: Counter[str], last_resort: bool
) -> bool:
    """Add one to three occluders that together with the room hide `target`; False when nothing fits.

    Args:
        last_resort: Whether unattached shelf boards are allowed, too.
    """
    if target == 0 or abs(stage.hidden_share() - target) <= FIT_TOLERANCE:
        return True
    already = stage.hidden_share()
    count = 1 if target - already < 0.08 else int(rng.choice([1, 2, 3], p=[0.45, 0.35, 0.2]))
    levels = already + (target - already) * np.cumsum(rng.dirichlet(np.full(count, 2.0)))
    for level in levels[:-1]:
        make = draw_kind(stage, rng, level, last_resort)
        _count(rejected, _place(stage, make and make(stage, rng, level), level))
    hopeless: set[Kind] = set()
    kinds_tried, trials_per_kind = 6, 8  # number of draws of the last occluder before the room is given up
    for _ in range(kinds_tried):
        make = draw_kind(stage, rng, target, last_resort, hopeless)
        if make is None:
            break
        for _ in range(trials_per_kind):
            candidate = make(stage, rng, target)
            reason = _place(stage, candidate, target)
            if not reason:
                return True
            _count(rejected, reason)
            if candidate is None:
                hopeless.add(make)
                break
    return False


def _count(rejected: Counter[str], reason: str) -> None:
    if reason:
        rejected[f"occluder {reason}"] += 1


def _place(stage: StagedRoom, candidate: OccluderCandidate | None, level: float) -> str:
    """Move a candidate until `level` is hidden and keep it, or return the reason of its rejection."""
    if candidate is None:
        return "no room"
    forward = stage.actor.view.forward
    if candidate.front < forward @ stage.actor.view.eye + stage.nearest:
        return "eye"  # at any offset: motions are across the line of sight
    if candidate.bound < level - FIT_TOLERANCE:
        return "too small"
    ends = candidate.least, candidate.most
    placement = stage.settle(candidate.parts, candidate.motion, ends, level, FIT_TOLERANCE)
    if isinstance(placement, str):
        return placement
    offset, depths = placement
    shift = offset * candidate.motion
    footprints = [Footprint.of(stage.points(part) + shift, forward) for part in candidate.parts]
    for footprint in footprints:
        if reason := stage.check(footprint):
            return reason
    if not candidate.stands and (stage.behind < depths + 2 * stage.margin)[np.isfinite(depths)].any():
        return "in furniture"
    if (np.minimum(stage.blockers, depths) < stage.behind).mean() > 0.3 + 0.5 * level:
        return "fills the frame"
    parts = [part.shift(shift) for part in candidate.parts]
    arms = [part for part in parts if part.role == "holder" and part.family == "arm"]
    # nothing may seem to float
    if arms and (stage.depth_of_props(arms) <= depths)[np.isfinite(depths)].mean() < 0.02:
        return "no hand"
    stage.add(parts, footprints, depths)
    return ""
