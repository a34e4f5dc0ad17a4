"""Places props between the eye and the object so that a chosen share of it is hidden."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.transform import Rotation

from vig.scene import ObjectClass
from vig.synthesis import assets
from vig.synthesis.footprint import Footprint
from vig.synthesis.props import FAMILIES
from vig.synthesis.spec import Placed, Role, Room, Split
from vig.synthesis.view import View

LAYOUT_SIZE = 75
"""Pixels on a side of the masks on which placements are judged."""
FIT_TOLERANCE = 0.008
NEAREST = 0.09
"""Nothing comes nearer to the eye's image plane than this, metres."""
MARGIN = 0.004
CLUTTER_COVER = 0.3
"""The window of a single piece of clutter covers no more of the frame than this."""
KINDS_TRIED, TRIALS_PER_KIND = 6, 8
"""How often the last occluder is drawn before the room is given up."""


@dataclass
class Stage:
    """A room with the object in it, filled prop by prop; what is hidden is kept up to date.

    object_depth, blockers: (75, 75) metres, inf = nothing: the object alone, and the nearest of the props.
    ahead, aside: unit vectors (3,) in the ground plane, away from the eye and to its right.
    """

    split: Split
    room: Room
    view: View
    body: Footprint
    object_depth: np.ndarray
    blockers: np.ndarray
    ahead: np.ndarray
    aside: np.ndarray
    elevation: float
    props: list[Placed] = field(default_factory=list)
    solids: list[Footprint] = field(default_factory=list)

    @staticmethod
    def empty(
        object_class: ObjectClass,
        vertices: np.ndarray,
        azimuth: float,
        elevation: float,
        room: Room,
        split: Split,
    ) -> Stage:
        """A room with the object (V, 3) alone."""
        view = View.of(object_class, azimuth, elevation, LAYOUT_SIZE)
        depth = view.depth(vertices, object_class.shape_model.faces)
        return Stage(
            split=split,
            room=room,
            view=view,
            body=Footprint.of(vertices, view.forward),
            object_depth=depth,
            blockers=np.full_like(depth, np.inf),
            ahead=np.array([-np.sin(azimuth), np.cos(azimuth), 0.0]),
            aside=np.array([np.cos(azimuth), np.sin(azimuth), 0.0]),
            elevation=elevation,
        )

    def hidden(self, extra: np.ndarray) -> float:
        """Share of the object's pixels behind the props or behind one more depth image (75, 75)."""
        seen = np.isfinite(self.object_depth)
        return float((np.minimum(self.blockers, extra)[seen] < self.object_depth[seen]).mean())

    def hidden_at_most(self, vertices: np.ndarray) -> float:
        """A bound of `hidden` for world points (V, 3), from their window in the frame."""
        full = np.full_like(self.blockers, np.inf)
        full[self.view.window(vertices)] = 0.0
        return self.hidden(full)

    def visible_ground(self) -> tuple[float, float]:
        """Nearest and farthest ground in the frame: metres ahead of the object's axis, at most 1.3."""
        height = self.view.eye[2]
        back = float(self.view.eye @ self.ahead)
        half = np.arctan(self.view.camera.height / 2 / self.view.camera.focal)
        steep, shallow = self.elevation + half, self.elevation - half
        near = back + height / np.tan(steep)
        far = back + height / np.tan(shallow) if shallow > 0.05 else np.inf
        return near, float(min(far + 0.05, 1.3))

    def check(self, footprint: Footprint) -> str:
        """Why a solid cannot be there: `collision`, `eye` or an empty string."""
        if footprint.depths[0] < self.view.forward @ self.view.eye + NEAREST:
            return "eye"
        clear = all(footprint.clear_of(solid, MARGIN) for solid in [self.body, *self.solids])
        return "" if clear else "collision"

    def add(self, placed: list[Placed], footprints: list[Footprint], depth: np.ndarray) -> None:
        """Keep props, given with their footprints and their common depth image."""
        self.props += placed
        self.solids += footprints
        self.blockers = np.minimum(self.blockers, depth)

    def try_clutter(self, placed: Placed) -> str:
        """Keep a prop if it hides nothing of the object; else say why not in a word."""
        vertices, faces = world(self.split, placed)
        footprint = Footprint.of(vertices, self.view.forward)
        if not footprint.within(self.room.directions(), self.room.extents(), 0.01):
            return "off support"
        if reason := self.check(footprint):
            return reason
        rows, columns = self.view.window(vertices)
        cover = (rows.stop - rows.start) * (columns.stop - columns.start) / self.object_depth.size
        if cover == 0 or cover > CLUTTER_COVER:
            return "unseen" if cover == 0 else "too large"
        near = footprint.depths[0] < self.body.depths[1]
        if near and np.isfinite(self.object_depth[rows, columns]).any():
            depth = self.view.depth(vertices, faces)
            if self.hidden(depth) > self.hidden(self.blockers):
                return "hides the object"
        self.props.append(placed)
        self.solids.append(footprint)
        return ""


def world(split: Split, placed: Placed) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (V, 3) in the world and faces (F, 3) of a placed prop."""
    mesh = assets.prop_mesh(split, placed.family, placed.asset)
    rotation = Rotation.from_rotvec(placed.rotation).as_matrix()
    return mesh.vertices @ rotation.T + np.array(placed.position), mesh.faces


@dataclass(frozen=True)
class Candidate:
    """Props that move together along a line: at offset `least` they hide most, at `most` nothing.

    parts: the props at offset zero. motion: unit vector (3,). stands: whether they need the support.
    """

    parts: list[Placed]
    motion: np.ndarray
    least: float
    most: float
    stands: bool


def hide(stage: Stage, target: float, rng: np.random.Generator, rejected: Counter[str]) -> bool:
    """Add one to three occluders until `target` of the object is hidden; False if no draw did.

    rejected: counts the placements thrown away, by reason.
    """
    if target == 0:
        return True
    count = 1 if target < 0.08 else int(rng.choice([1, 2, 3], p=[0.45, 0.35, 0.2]))
    levels = target * np.cumsum(rng.dirichlet(np.full(count, 2.0)))
    for level in levels[:-1]:
        _count(rejected, _place(stage, _draw_kind(stage, rng)(stage, rng), level))
    for _ in range(KINDS_TRIED):
        make = _draw_kind(stage, rng)
        for _ in range(TRIALS_PER_KIND):
            reason = _place(stage, make(stage, rng), target)
            if not reason:
                return True
            _count(rejected, reason)
    return False


def _count(rejected: Counter[str], reason: str) -> None:
    if reason:
        rejected[f"occluder {reason}"] += 1


def _place(stage: Stage, candidate: Candidate, level: float) -> str:
    """Bisect a candidate's offset until `level` is hidden and keep it, or say why not in a word."""
    meshes = [world(stage.split, part) for part in candidate.parts]
    vertices, faces = _joined(meshes)
    nearest = ((vertices - stage.view.eye) @ stage.view.forward).min()
    slope = min(
        candidate.motion @ stage.view.forward * offset for offset in (candidate.least, candidate.most)
    )
    if nearest + slope < NEAREST:
        return "eye"
    low, high = candidate.least, candidate.most
    if stage.hidden_at_most(vertices + low * candidate.motion) < level - FIT_TOLERANCE:
        return "too small"
    depth = stage.view.depth(vertices + low * candidate.motion, faces)
    hidden, offset = stage.hidden(depth), low
    if hidden < level - FIT_TOLERANCE:
        return "too small"
    for _ in range(11):
        if abs(hidden - level) <= FIT_TOLERANCE:
            break
        low, high = (offset, high) if hidden > level else (low, offset)
        offset = (low + high) / 2
        depth = stage.view.depth(vertices + offset * candidate.motion, faces)
        hidden = stage.hidden(depth)
    else:
        return "no offset"
    shift = offset * candidate.motion
    footprints = [Footprint.of(mesh[0] + shift, stage.view.forward) for mesh in meshes]
    ends = stage.room.extents() if candidate.stands else stage.room.walls
    for footprint in footprints:
        if reason := stage.check(footprint):
            return reason
        if footprint.heights[0] < -1e-4 or (
            candidate.stands and not footprint.within(stage.room.directions(), ends, 0.005)
        ):
            return "off support"
    if np.isfinite(np.minimum(stage.blockers, depth)).mean() > 0.3 + 0.5 * level:
        return "fills the frame"
    stage.add([_moved(part, shift) for part in candidate.parts], footprints, depth)
    return ""


def _moved(part: Placed, shift: np.ndarray) -> Placed:
    x, y, z = (np.array(part.position) + shift).tolist()
    return Placed(part.family, part.asset, (x, y, z), part.rotation, part.role)


def _draw_kind(stage: Stage, rng: np.random.Generator) -> Callable[[Stage, np.random.Generator], Candidate]:
    """A way to hide the object that suits the elevation: what stands hides little from above."""
    high = float(np.clip((stage.elevation - 0.5) / 0.7, 0, 1))
    chances = {
        _standing: 0.8 - 0.7 * high,
        _in_hand: 0.1 + 0.45 * high,
        _twig: 0.1 + 0.1 * high,
        _hanging: 0.12 * (stage.elevation < 0.7),
        _board: 0.12 * (stage.elevation > 0.5),
    }
    kinds, weights = list(chances), np.array(list(chances.values()))
    return kinds[int(rng.choice(len(kinds), p=weights / weights.sum()))]


def draw_prop(rng: np.random.Generator, split: Split) -> tuple[str, int]:
    """A random member of the prop catalogue of a split: its family and number."""
    return str(rng.choice(list(FAMILIES))), _member(rng, split)


def _member(rng: np.random.Generator, split: Split) -> int:
    return int(rng.integers(assets.PROPS_PER_FAMILY[split]))


def _placed(
    name: tuple[str, int], position: np.ndarray, rotation: Rotation, role: Role = "occluder"
) -> Placed:
    x, y, z = position.tolist()
    rx, ry, rz = rotation.as_rotvec().tolist()
    return Placed(name[0], name[1], (x, y, z), (rx, ry, rz), role)


def _standing(stage: Stage, rng: np.random.Generator) -> Candidate:
    """A prop on the same support, between the eye and the object; moves sideways."""
    name = draw_prop(rng, stage.split)
    turn = Rotation.from_euler("z", rng.uniform(0, 2 * np.pi))
    vertices = turn.apply(assets.prop_mesh(stage.split, *name).vertices)
    gap = MARGIN + 0.002 + rng.uniform(0, 0.1) * np.cos(stage.elevation)
    distance = (stage.body.outline @ -stage.ahead[:2]).max() + (vertices @ stage.ahead).max() + gap
    part = _placed(name, -distance * stage.ahead, turn)
    return Candidate([part], rng.choice([-1.0, 1.0]) * stage.aside, 0.0, 0.5, True)


def _aim(stage: Stage, rng: np.random.Generator, half_depth: float) -> np.ndarray:
    """A point (3,) on the ray to the object's middle, nearer than the object by more than `half_depth`."""
    free = stage.body.depths[0] - stage.view.forward @ stage.view.eye - half_depth - 2 * MARGIN
    depth = rng.uniform(min(0.14, free), max(free, 0.14))
    rows, columns = np.nonzero(np.isfinite(stage.object_depth))
    camera = stage.view.camera
    x = (columns.mean() + 0.5 + rng.normal(0, 2) - camera.cx) / camera.focal
    y = (rows.mean() + 0.5 + rng.normal(0, 2) - camera.cy) / camera.focal
    return stage.view.eye + stage.view.rotation.T @ (depth * np.array([x, y, 1.0]))


def _outward(stage: Stage, rng: np.random.Generator) -> np.ndarray:
    """A random unit vector (3,) in the image plane."""
    angle = rng.uniform(0, 2 * np.pi)
    return np.cos(angle) * stage.view.rotation[0] + np.sin(angle) * stage.view.rotation[1]


def _along(direction: np.ndarray, forward: np.ndarray, roll: float = 0.0) -> Rotation:
    """A rotation that takes +X to `direction`, with `roll` radians about it."""
    y = np.cross(forward, direction)
    y /= np.linalg.norm(y)
    frame = Rotation.from_matrix(np.stack([direction, y, np.cross(direction, y)], axis=1))
    return frame * Rotation.from_euler("x", roll)


def _in_hand(stage: Stage, rng: np.random.Generator) -> Candidate:
    """A tilted prop held by an arm that comes from outside the frame."""
    name = draw_prop(rng, stage.split)
    turn = Rotation.from_euler("zxz", [rng.uniform(0, 6.3), rng.uniform(0, 1.2), rng.uniform(0, 6.3)])
    vertices = turn.apply(assets.prop_mesh(stage.split, *name).vertices)
    middle = (vertices.max(0) + vertices.min(0)) / 2
    depth = vertices @ stage.view.forward
    outward = _outward(stage, rng)
    aim = _aim(stage, rng, (depth.max() - depth.min()) / 2)
    arm = ("arm", _member(rng, stage.split))
    grip = 0.8 * ((vertices - middle) @ outward).max()
    parts = [
        _placed(name, aim - middle, turn),
        _placed(
            arm, aim + grip * outward, _along(outward, stage.view.forward, rng.uniform(0, 6.3)), "holder"
        ),
    ]
    return Candidate(parts, outward, -0.06, 0.4, False)


def _twig(stage: Stage, rng: np.random.Generator) -> Candidate:
    """A leafy twig that reaches into the frame."""
    outward = _outward(stage, rng)
    twig = ("twig", _member(rng, stage.split))
    rotation = _along(outward, stage.view.forward, rng.normal(0, 0.3))
    return Candidate([_placed(twig, _aim(stage, rng, 0.03), rotation)], outward, -0.3, 0.2, False)


def _board(stage: Stage, rng: np.random.Generator) -> Candidate:
    """The end of a shelf board above the object."""
    turn = rng.uniform(-0.3, np.pi + 0.3)
    outward = np.cos(turn) * stage.aside + np.sin(turn) * stage.ahead
    board = ("board", _member(rng, stage.split))
    rotation = Rotation.from_euler("z", np.arctan2(outward[1], outward[0]))
    return Candidate([_placed(board, _aim(stage, rng, 0.06), rotation)], outward, -0.3, 0.3, False)


def _hanging(stage: Stage, rng: np.random.Generator) -> Candidate:
    """An upright prop on a cord; moves sideways."""
    name = draw_prop(rng, stage.split)
    turn = Rotation.from_euler("z", rng.uniform(0, 2 * np.pi))
    vertices = turn.apply(assets.prop_mesh(stage.split, *name).vertices)
    depth = vertices @ stage.view.forward
    middle = (vertices.max(0) + vertices.min(0)) / 2
    aim = _aim(stage, rng, (depth.max() - depth.min()) / 2)
    top = aim + np.array([0.0, 0.0, (vertices[:, 2].max() - vertices[:, 2].min()) / 2])
    cord = ("cord", _member(rng, stage.split))
    parts = [
        _placed(name, aim - middle, turn),
        _placed(cord, top - np.array([0.0, 0.0, 0.002]), Rotation.identity(), "holder"),
    ]
    return Candidate(parts, rng.choice([-1.0, 1.0]) * stage.aside, 0.0, 0.4, False)


def measure(
    object_class: ObjectClass,
    vertices: np.ndarray,
    props: list[Placed],
    azimuth: float,
    elevation: float,
    split: Split,
) -> float:
    """The hidden share of the object (V, 3) at the full size of the image, one sample per pixel."""
    view = View.of(object_class, azimuth, elevation)
    alone = view.depth(vertices, object_class.shape_model.faces)
    seen = np.isfinite(alone)
    blockers = view.depth(*_joined([world(split, placed) for placed in props])) if props else np.inf
    return float((blockers < alone)[seen].mean())


def _joined(meshes: list[tuple[np.ndarray, np.ndarray]]) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and faces of several meshes as one."""
    starts = np.cumsum([0] + [len(mesh[0]) for mesh in meshes])
    faces = [mesh[1] + start for mesh, start in zip(meshes, starts, strict=False)]
    return np.concatenate([mesh[0] for mesh in meshes]), np.concatenate(faces)
