"""Videos of a turning object before a still camera, while its occluders pass from one side to the other."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from vig.io.errors import UserError
from vig.scene import ObjectClass, rotate_z
from vig_world.assets.target import target_vertices
from vig_world.composition.sampling import CompositionError, measure, sample
from vig_world.composition.stage import LAYOUT_SIZE, Actor
from vig_world.dataset.spec import SceneSpec
from vig_world.library import Library
from vig_world.raster.view import View
from vig_world.rotations import about_z, vector_of
from vig_world.streams import stream

HIDDEN, OPEN = (0.55, 0.95), 0.15
"""Share of the object that is hidden as the props pass, and at most that is when they are away."""
TURNING_STREAM = 2**20 + 5
TURNS, UNEVEN = (0.5, 1.0), 0.5
"""Turns of the object in a video, in either sense; how much its speed may vary."""
WAY = 1.2
"""Distance that the props move to either side, over the object's greatest distance from its axis."""


@dataclass(frozen=True)
class Turning:
    """A video: its scene as the props hide most, and how they and the object move.

    Attributes:
        scene: Half-way through the video.
        turn: Radians by which the object turns about its vertical axis, from the first frame to the last.
        uneven: Share by which its speed rises and falls about the mean, once in the video.
        phase: Phase of that at the start, radians.
        way: (3,) metres by which its occluders move meanwhile.
    """

    scene: SceneSpec
    turn: float
    uneven: float
    phase: float
    way: tuple[float, float, float]

    def frames(self, count: int) -> Iterator[SceneSpec]:
        """Yield the scenes of `count` frames; each one's azimuth and hidden parts are those of the frame."""
        whole = 2 * math.pi
        for time in np.linspace(-0.5, 0.5, count).tolist():
            turn = time + self.uneven / whole * math.sin(whole * time + self.phase)
            shift = time * np.array(self.way)
            props = tuple(prop if prop.role == "clutter" else prop.shift(shift) for prop in self.scene.props)
            yield turn_scene(replace(self.scene, props=props), -turn * self.turn)


def draw_turning(library: Library, object_class: ObjectClass, seed: int, index: int) -> Turning:
    """Draw video number `index` of a seed, from the photographs of `sample`.

    The scene is the first of `100 index`, `100 index + 1` ... that props hide by a share within `HIDDEN`,
    while room and clutter hide no more than `OPEN`.

    Raises:
        UserError: None of a hundred scenes is like that.
    """
    rng = stream(seed, index, library.split, TURNING_STREAM)
    for number in range(100 * index, 100 * (index + 1)):
        try:
            scene = sample(library, object_class, seed, number)
        except CompositionError:
            continue
        if not HIDDEN[0] <= scene.occlusion <= HIDDEN[1]:
            continue
        vertices, view = target_vertices(scene, object_class), View.of_scene(scene, object_class, LAYOUT_SIZE)
        actor = Actor.of(view, object_class, vertices, scene.elevation, scene.azimuth)
        staying = [prop for prop in scene.props if prop.role == "clutter"]
        if measure(library, actor, scene.room, staying) <= OPEN:
            break
    else:
        raise UserError(
            f"video {index} of seed {seed}: expected props that hide {HIDDEN[0]:.0%} to {HIDDEN[1]:.0%} of"
            " the object; none of 100 scenes has them. Use another seed."
        )
    reach = float(np.linalg.norm(vertices[:, :2], axis=1).max())
    turn = 2 * math.pi * rng.uniform(*TURNS) * rng.choice([-1.0, 1.0])
    x, y, z = (2 * WAY * reach * rng.choice([-1.0, 1.0]) * actor.aside).tolist()
    uneven, phase = rng.uniform(0, [UNEVEN, 2 * math.pi]).tolist()
    return Turning(scene, float(turn), uneven, phase, (x, y, z))


def turn_scene(scene: SceneSpec, angle: float, origin: np.ndarray | float = 0.0) -> SceneSpec:
    """Return the scene in a frame that lies at `origin` (3,), turned back by `angle` radians about +Z.

    Everything turns about that place by the angle, the camera included; its azimuth and elevation are right
    where `origin` is 0, else they must be replaced.
    """
    turn, room = about_z(angle), scene.room

    def place(position: tuple[float, float, float]) -> tuple[float, float, float]:
        x, y, z = (turn @ (np.array(position) - origin)).tolist()
        return x, y, z

    props = (
        replace(prop, position=place(prop.position), rotation=vector_of(turn @ prop.matrix()))
        for prop in scene.props
    )
    return replace(
        scene,
        azimuth=(scene.azimuth + angle) % (2 * math.pi),
        light=tuple(rotate_z(np.array(scene.light, np.float64), angle).tolist()),
        panorama_angle=scene.panorama_angle + angle,
        room=replace(room, origin=place(room.origin), turn=room.turn + angle),
        props=tuple(props),
    )
