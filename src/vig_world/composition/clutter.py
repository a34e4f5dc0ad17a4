"""Scatters props over the supports, near the object and in the background, without hiding it."""

from collections import Counter
from dataclasses import dataclass

import numpy as np

from vig_world.assets.footprint import Footprint
from vig_world.assets.things import Support
from vig_world.composition.occluders import place_prop
from vig_world.composition.stage import MARGIN, StagedRoom
from vig_world.rotations import about_z, turn_about_z

FAR = 4.5  # metres from the camera beyond which supports are left empty
BACKGROUND = 4  # number of supports besides the object's own on which clutter is scattered


def scatter(stage: StagedRoom, rng: np.random.Generator, rejected: Counter[str]) -> None:
    """Place clutter on the object's own support round the object, and on others in view."""
    wanted = int(rng.integers(2, 9))
    near, far = visible_ground(stage)
    large = max(1.0, stage.actor.scale)
    ahead = rng.uniform(near, far, 2 * wanted)
    aside = rng.uniform(-1, 1, 2 * wanted) * (0.45 * (ahead - near) + 0.25 * large)
    spots = np.outer(ahead, stage.actor.ahead) + np.outer(aside, stage.actor.aside)
    own = [stage.on_support(stage.support, spots)]
    supports = 2 * wanted * [stage.support]
    for support in _in_background(stage, rng):
        count = int(rng.integers(1, 6))
        x, y = rng.uniform(-1, 1, (2, count))
        own.append(np.column_stack([x * support.half[0], y * support.half[1], 0 * x]))
        supports += count * [support]
    proposals = _Proposals.draw(stage, rng, supports, np.concatenate(own))
    for reason, count in proposals.unfit.items():
        rejected[f"clutter {reason}"] += count
    placed_here: list[int] = []
    for number in proposals.fit:
        if number < 2 * wanted and sum(each < 2 * wanted for each in placed_here) == wanted:
            continue
        reason = proposals.obstacle(stage, number, placed_here)
        if reason:
            rejected[f"clutter {reason}"] += 1
        else:
            placed_here.append(number)


def visible_ground(stage: StagedRoom) -> tuple[float, float]:
    """Return the nearest and farthest ground in the frame, metres ahead of the object's axis.

    At most 1.3, or so much more as the object is larger than teapots.
    """
    view = stage.actor.view
    height, back = view.eye[2], float(view.eye @ stage.actor.ahead)
    half = np.arctan(view.camera.height / 2 / view.camera.focal)
    steep, shallow = stage.actor.elevation + half, stage.actor.elevation - half
    near = back + height / np.tan(steep)
    far = back + height / np.tan(shallow) if shallow > 0.05 else np.inf
    return near, float(min(far + 0.05, 1.3 * max(1.0, stage.actor.scale)))


def _in_background(stage: StagedRoom, rng: np.random.Generator) -> list[Support]:
    """Return up to four other supports with middles before the camera and not too far, in random order."""
    supports = stage.library.plan(stage.room.layout).layout.supports
    middles = stage.room.to_world(np.array([support.centre for support in supports]))
    x, y, z = ((middles - stage.actor.view.eye) @ stage.actor.view.rotation.T).T
    in_view = (z > 0.3) & (z < FAR) & (np.abs(x) < 0.8 * z + 0.3) & (np.abs(y) < 0.8 * z + 0.3)
    in_view[stage.room.support] = False
    chosen = rng.permutation(np.nonzero(in_view)[0])[:BACKGROUND]
    return [supports[number] for number in chosen if supports[number].zone != "floor"]


def draw_props(stage: StagedRoom, rng: np.random.Generator, zones: list[str]) -> list[tuple[str, int]]:
    """Return family and number of a random prop for each of several zones, each of which belongs there."""
    names = []
    for zone, (family_at, member_at) in zip(zones, rng.random((len(zones), 2)).tolist(), strict=True):
        families = stage.families(zone)
        family = families[int(family_at * len(families))]
        names.append((family, int(member_at * stage.library.members(family))))
    return names


@dataclass(frozen=True)
class _Proposals:
    """N candidate props.

    names: the props. positions: (N, 3) metres. angles: (N,) radians about +Z. footprints: their bounds.
    touch: (N, N) bool, whether two touch or nearly so. crosses: (N,) whether the window of one that is before
    the object's back shows a pixel of it. fit: numbers of those that fit on their supports, are seen, and
    touch nothing placed before; unfit: counts of the rest.
    """

    names: list[tuple[str, int]]
    positions: np.ndarray
    angles: np.ndarray
    footprints: Footprint
    touch: np.ndarray
    crosses: np.ndarray
    fit: list[int]
    unfit: Counter[str]

    @staticmethod
    def draw(
        stage: StagedRoom, rng: np.random.Generator, supports: list[Support], own: np.ndarray
    ) -> "_Proposals":
        """Return random props as near to spots (N, 3) on supports (N), in their frames, as the edges allow.

        Half of them are square to the support's edges.
        """
        count, view = len(supports), stage.actor.view
        names = draw_props(stage, rng, [support.zone for support in supports])
        square = np.array([support.turn for support in supports]) + stage.room.turn
        square += rng.choice([0.0, np.pi, np.pi / 2], count) + rng.normal(0, 0.08, count)
        angles = np.where(rng.uniform(size=count) < 0.5, square, rng.uniform(0, 2 * np.pi, count))
        clouds = turn_about_z(np.stack([stage.library.extremes(*name) for name in names]), angles)
        poses = [stage.pose(support) for support in supports]
        rotations, origins = np.array([pose[0] for pose in poses]), np.array([pose[1] for pose in poses])
        reach = np.abs(clouds @ rotations[..., :2]).max(1)
        free = np.array([support.half for support in supports]) - reach - 2 * MARGIN
        clearance = np.array([support.clearance for support in supports])
        fits = (free >= 0).all(1) & (clouds[..., 2].max(1) <= clearance - MARGIN)
        spots = np.zeros((count, 3))
        spots[:, :2] = np.clip(own[:, :2], -free, free)
        positions = (rotations @ spots[..., None])[..., 0] + origins
        clouds += positions[:, None]

        footprints = Footprint.of(clouds, view.forward)
        in_front = footprints.depths[:, 0] >= view.forward @ view.eye + stage.nearest
        top, bottom, left, right = view.windows(clouds)
        cover = (bottom - top) * (right - left) / stage.actor.depth.size
        sums = stage.actor.sums
        shown = sums[bottom, right] - sums[top, right] - sums[bottom, left] + sums[top, left]
        pairwise = footprints[:, None]
        free_of_others = (pairwise.gap(stage.obstacles()) >= MARGIN).all(1)
        unfit: Counter[str] = Counter()
        fit = np.ones(count, bool)
        for reason, passes in (
            ("too large", fits),
            ("eye", in_front),
            ("unseen", cover > 0),
            ("too large", cover <= 0.3),  # of the frame
            ("collision", free_of_others),
        ):
            unfit[reason] += int((fit & ~passes).sum())
            fit &= passes
        return _Proposals(
            names=names,
            positions=positions,
            angles=angles,
            footprints=footprints,
            touch=pairwise.gap(footprints) < MARGIN,
            crosses=(footprints.depths[:, 0] < stage.actor.body.depths[1]) & (shown > 0),
            fit=np.flatnonzero(fit).tolist(),
            unfit=unfit,
        )

    def obstacle(self, stage: StagedRoom, number: int, others: list[int]) -> str:
        """Place one of the props beside others, or return the kind of obstacle."""
        if self.touch[number, others].any():
            return "collision"
        turn = about_z(float(self.angles[number]))
        part, depths = place_prop(self.names[number], self.positions[number], turn, "clutter"), None
        if self.crosses[number]:
            depths = stage.depth_of_props([part])
            if stage.hidden_share(depths) > stage.hidden_share():
                return "hides the object"
        stage.add([part], [self.footprints[number]], depths)
        return ""
