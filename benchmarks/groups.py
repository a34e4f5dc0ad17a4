"""Photographs of two to four objects that stand together and hide one another, with their truth.

They are drawn by the generator, for `benchmarks.together` and for tests.
"""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from benchmarks.turning import turn_scene
from vig.io.errors import UserError
from vig.photo.masks import box_of
from vig.scene import ObjectClass, linear_from_srgb
from vig_world.assets.coats import draw_coat, mean_albedo
from vig_world.assets.footprint import Footprint, extreme_points
from vig_world.assets.target import draw_shape, standing_vertices, target_vertices
from vig_world.composition.photographs import DECORATED, METAL
from vig_world.composition.sampling import CompositionError, sample
from vig_world.composition.stage import LAYOUT_SIZE, MARGIN, Actor, StagedRoom
from vig_world.dataset.spec import SceneSpec, Split
from vig_world.library import Library
from vig_world.raster.draw import depth
from vig_world.raster.view import View
from vig_world.renderers.photo import photograph
from vig_world.renderers.rasterized import items_of, render
from vig_world.rotations import about_z
from vig_world.streams import stream

WIDTH, HEIGHT = 480, 360
FINER = 2
"""Pixels drawn along a side of each pixel of the image, so that the edges between objects are blended."""
HIDES = 12
"""Pixels of one object that another hides to be before it."""
GROUP_STREAM = 2**20 + 8
"""Number of the random streams of groups of a seed."""
SMALLER = 0.45
"""Size of the first object in the frame, over that in a photo of its own."""
MAX_HIDDEN = 0.3
"""Largest share of the first object that other things than the group hide."""
NEAR = 0.14
"""Metres between the objects of a group, at most; so much more where they are larger than teapots."""
OVERLAP = 0.08
"""Least share of the smaller silhouette that two objects share on the image, for one to join the group."""
MIN_SEEN = 0.3
"""Share of each object that is seen, at least."""
WITHIN = 0.97
"""Share of each object within the frame, at least."""
DRAWS, GROUPS, REDRAWN = 80, 12, 8
"""Draws of an object to join, of groups, and of these anew from other streams, before they are given up."""


@dataclass(frozen=True)
class Member:
    """One object of a group.

    Attributes:
        class_name: Name of its class.
        scene: Room, props, light and this object, all in the object's own frame: its latents are those of
            the object alone. Its lens is not the camera's.
        turn: Radians about +Z from its frame to the first member's.
        position: Metres (x, y) of its origin in the first member's frame.
    """

    class_name: str
    scene: SceneSpec
    turn: float
    position: tuple[float, float]

    def view(self, first: View) -> View:
        """Return the camera in this object's frame, from that in the first member's."""
        rotation, offset = about_z(self.turn), np.array([*self.position, 0.0])
        return View(first.camera, first.rotation @ rotation, first.rotation @ offset + first.translation)


@dataclass(frozen=True)
class GroupSpec:
    """A scene of several objects; the first is that of `members[0]`, whose lens is the camera's."""

    members: tuple[Member, ...]

    def views(self, classes: Sequence[ObjectClass], width: int, height: int) -> list[View]:
        """Return the camera in each member's frame, for an image of width x height pixels."""
        first = self.members[0]
        object_class = next(each for each in classes if each.name == first.class_name)
        view = View.of_scene(first.scene, object_class, height).reframe(width, height)
        return [member.view(view) for member in self.members]


def sample_group(
    library: Library, classes: Sequence[ObjectClass], seed: int, index: int, aspect: float = 4 / 3
) -> GroupSpec:
    """Draw group number `index` of a seed: two to four objects, each seen to 30 % or more.

    The first is drawn as `sample` draws one, smaller in the frame and little hidden by other things; the
    others stand beside it on the same support, each overlapping another on the image.

    Args:
        library: Assets of the split.
        classes: Each object is of one of them.
        seed: Seed of the groups.
        index: Number of the group.
        aspect: Width over height of the image.

    Raises:
        UserError: No group was found in `REDRAWN` times `GROUPS` rooms.
    """
    for draw, attempt in itertools.product(range(REDRAWN), range(GROUPS)):
        rng = stream(seed, index, library.split, GROUP_STREAM + attempt, draw)
        wanted = 2 + int(rng.choice(3, p=[0.4, 0.35, 0.25]))
        first = classes[int(rng.integers(len(classes)))]
        hidden = float(rng.uniform(0, MAX_HIDDEN)) if rng.random() < 0.4 else 0.0
        number = GROUPS * index + attempt
        try:
            scene = sample(library, first, seed, number, smaller=SMALLER, target=hidden, draw=draw)
        except CompositionError:  # no room hides it as it should, so far from the camera
            continue
        group = _GroupBuilder(library, classes, scene, first, aspect)
        for _ in range(DRAWS):
            if len(group.members) == wanted:
                return GroupSpec(tuple(group.members))
            group.try_one(rng)
    raise UserError(f"group {index} of seed {seed}: expected a place for it; got none. Use another seed.")


class _GroupBuilder:
    """A group under construction."""

    def __init__(
        self,
        library: Library,
        classes: Sequence[ObjectClass],
        scene: SceneSpec,
        first: ObjectClass,
        aspect: float,
    ):
        self.library, self.classes, self.scene = library, classes, scene
        self.members = [Member(first.name, scene, 0.0, (0.0, 0.0))]
        height = 2 * LAYOUT_SIZE
        self.view = View.of_scene(scene, first, height).reframe(round(aspect * height), height)
        vertices = target_vertices(scene, first)
        actor = Actor.of(
            View.through(scene.lens, first, scene.azimuth, scene.elevation, LAYOUT_SIZE),
            first, vertices, scene.elevation, scene.azimuth,
        )  # fmt: skip
        self.stage = StagedRoom.empty(library, actor, scene.room)
        for prop in scene.props:
            footprint = Footprint.of(self.stage.points(prop), actor.view.forward)
            self.stage.add([prop], [footprint], None)
        self.bodies = [actor.body]
        self.alone = [self.view.depth(vertices, first.shape_model.faces)]
        self.others = depth(items_of(library, scene.props, scene.room), self.view)[0]  # of room and props

    def try_one(self, rng: np.random.Generator) -> None:
        """Add an object where it has room, overlaps another on the image, and leaves all to be seen."""
        object_class = self.classes[int(rng.integers(len(self.classes)))]
        shape, design = draw_shape(rng, object_class, self.library.split)
        vertices = standing_vertices(shape, design, object_class)
        beside = self.bodies[int(rng.integers(len(self.bodies)))].outline.mean(0)
        turn, bearing = rng.uniform(0, 2 * np.pi, 2)
        scale = max(object_class.scale, self.stage.actor.scale)
        reach = float(np.abs(vertices[:, :2]).max())
        distance = reach + rng.uniform(0.02, 0.02 + reach + NEAR * scale)
        position = beside + distance * np.array([math.cos(bearing), math.sin(bearing)])
        moved = vertices @ about_z(turn).T.astype(np.float32) + np.array([*position, 0.0], np.float32)
        cloud = extreme_points(moved)
        own = self.stage.on_support(self.stage.support, cloud)
        half = np.array(self.stage.support.half) - MARGIN
        if (np.abs(own[:, :2]) > half).any() or own[:, 2].max() > self.stage.support.clearance - MARGIN:
            return
        footprint = Footprint.of(cloud, self.stage.actor.view.forward)
        if self.stage.check(footprint):
            return
        alone = self.view.depth(moved, object_class.shape_model.faces)
        if not self._joins(alone, moved):
            return
        self.alone.append(alone)
        self.bodies.append(footprint)
        self.stage.add([], [footprint], None)
        coat = draw_coat(rng, len(object_class.shape_model.part_names), DECORATED, METAL)
        albedo = mean_albedo(coat, vertices, object_class.shape_model)
        place = (float(position[0]), float(position[1]))
        scene = replace(
            _seen_from(self.scene, object_class, self.view.eye, float(turn), place),
            shape=tuple(shape.tolist()),
            design=design,
            albedo=tuple(albedo.tolist()),
            coat=coat,
        )
        self.members.append(Member(object_class.name, scene, float(turn), place))

    def _joins(self, alone: np.ndarray, vertices: np.ndarray) -> bool:
        mine = np.isfinite(alone)
        inside = vertices @ self.view.rotation.T + self.view.translation
        camera = self.view.camera
        pixels = camera.focal * inside[:, :2] / inside[:, 2:] + [camera.cx, camera.cy]
        if (((pixels >= 0) & (pixels < [camera.width, camera.height])).all(1)).mean() < WITHIN:
            return False
        theirs = [np.isfinite(other) for other in self.alone]
        shares = [(mine & each).sum() / max(1, min(mine.sum(), each.sum())) for each in theirs]
        if max(shares) < OVERLAP:
            return False
        depths = np.stack([*self.alone, alone])
        nearest = np.minimum(depths.min(0), self.others)
        seen = [((each <= nearest) & np.isfinite(each)).sum() / np.isfinite(each).sum() for each in depths]
        return min(seen) >= MIN_SEEN


def _seen_from(
    scene: SceneSpec, object_class: ObjectClass, eye: np.ndarray, turn: float, place: tuple[float, float]
) -> SceneSpec:
    """Return a scene in another object's frame, turned by `turn` and placed at (x, y) in the scene's frame.

    azimuth and elevation are those of the camera (3,) about that object.
    """
    offset = np.array([*place, 0.0])
    x, y, z = about_z(-turn) @ (eye - offset) - [0.0, 0.0, object_class.target_height]
    return replace(
        turn_scene(scene, -turn, offset),
        azimuth=math.atan2(x, -y) % (2 * math.pi),
        elevation=math.asin(z / math.sqrt(x * x + y * y + z * z)),
    )


def photo_stream(seed: int, index: int, split: Split) -> np.random.Generator:
    """Return the generator of a group's photograph."""
    return stream(seed, index, split, GROUP_STREAM + GROUPS)


@dataclass(frozen=True)
class Group:
    """A photograph of N objects.

    Attributes:
        spec: The scene.
        views: The camera in each object's frame.
        photo: (H, W, 3) uint8 sRGB, through a camera model.
        amodal: (N, H, W) bool, each object alone.
        visible: (N, H, W) bool, each as seen.
        occludes: (N, N) bool, whether object i hides some of object j, `HIDES` pixels or more.
    """

    spec: GroupSpec
    views: tuple[View, ...]
    photo: np.ndarray
    amodal: np.ndarray
    visible: np.ndarray
    occludes: np.ndarray

    @property
    def boxes(self) -> list[list[int]]:
        """Return x, y, width, height in pixels round each whole object, within the photo."""
        return [list(box_of(mask) or ()) for mask in self.amodal]

    def truth(self) -> list[dict[str, Any]]:
        """Return plain values of each object, angles in degrees, pose, shape and albedo among them."""
        hidden = 1 - self.visible.sum((1, 2)) / self.amodal.sum((1, 2))
        objects = []
        for member, view, box, share in zip(self.spec.members, self.views, self.boxes, hidden, strict=True):
            pose = np.eye(4)
            pose[:3, :3], pose[:3, 3] = view.rotation, view.translation
            scene = member.scene
            objects.append(
                {"class": member.class_name, "box": box, "azimuth_deg": math.degrees(scene.azimuth),
                 "elevation_deg": math.degrees(scene.elevation), "hidden_fraction": float(share),
                 "K": view.camera.K.tolist(), "camera_from_object": pose.tolist(),
                 "shape": list(scene.shape), "albedo": list(scene.albedo)}
            )  # fmt: skip
        return objects


def make_group(
    library: Library,
    classes: Sequence[ObjectClass],
    seed: int,
    index: int,
    size: tuple[int, int] = (WIDTH, HEIGHT),
) -> Group:
    """Group number `index` of a seed, a photo of width x height pixels: a pure function of its arguments.

    Each object is drawn in its own frame, with room and props; each pixel is that of the nearest
    object. The room has the darkest shadow of any; objects cast none on each other.
    """
    spec = sample_group(library, classes, seed, index, size[0] / size[1])
    by_name = {each.name: each for each in classes}
    views = spec.views(classes, *size)
    drawn = [
        render(library, member.scene, by_name[member.class_name], view.scale(FINER))
        for member, view in zip(spec.members, views, strict=True)
    ]
    uncovered = np.stack([one.visible for one in drawn])
    depths = np.stack([np.where(one.visible, one.depth, np.inf) for one in drawn])
    pictures = np.stack([linear_from_srgb(one.image.astype(np.float32) / 255) for one in drawn])
    nearest = depths.argmin(0)
    darkest = pictures.sum(-1).argmin(0)
    chosen = np.where(uncovered.any(0), nearest, darkest)
    linear = np.take_along_axis(pictures, chosen[None, ..., None], 0)[0]
    amodal = np.stack([_halved(one.amodal) >= 0.5 for one in drawn])
    shares = np.stack([_halved(mask & (nearest == number)) for number, mask in enumerate(uncovered)])
    most = shares.argmax(0)
    visible = np.stack([(share >= 0.5) & (most == number) for number, share in enumerate(shares)])
    hides = uncovered[:, None] & uncovered & (depths[:, None] < depths)
    photo, _ = photograph(_halved(linear), photo_stream(seed, index, library.split))
    return Group(spec, tuple(views), photo, amodal, visible & amodal, hides.sum((2, 3)) >= FINER**2 * HIDES)


def _halved(image: np.ndarray) -> np.ndarray:
    """Return the mean over cells of FINER x FINER pixels of an image (H, W) or (H, W, C)."""
    height, width = image.shape[0] // FINER, image.shape[1] // FINER
    mean: np.ndarray = image.reshape(height, FINER, width, FINER, *image.shape[2:]).mean(axis=(1, 3))
    return mean
