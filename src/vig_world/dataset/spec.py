"""A synthetic scene as plain data: enough to build it again, with either renderer."""

import json
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Literal

import numpy as np

from vig.io.checks import decode, parse_json
from vig.io.errors import UserError
from vig_world import SPLITS as SPLITS
from vig_world import Split as Split
from vig_world.rotations import about_z, matrix_of

WORLD_VERSION = 7  # goes up whenever the same seed and index would give another scene or picture


class SampleError(UserError):
    """One sample cannot be made or read; another draw of it may do."""


Role = Literal["occluder", "holder", "clutter"]


@dataclass(frozen=True)
class Surface:
    """A textured finish: texture kind, its asset number, metres per repeat."""

    kind: str
    asset: int
    metres: float


@dataclass(frozen=True)
class Room:
    """A furnished room round the object, which stands at the world's origin.

    layout: asset number of the room. support: which of the layout's supports the object stands on; zone: of
    that support. origin: metres, where the layout's own origin lies in the world; turn: radians about +Z from
    the layout to the world. finishes: the covering of each slot of the layout, in the slots' order.
    """

    layout: int
    support: int
    zone: str
    origin: tuple[float, float, float]
    turn: float
    finishes: tuple[tuple[str, Surface], ...]

    def rotation(self) -> np.ndarray:
        """Return layout to world, (3, 3) float64."""
        return about_z(self.turn)

    def to_world(self, points: np.ndarray) -> np.ndarray:
        """Return points (..., 3) of the layout in the world."""
        return points @ self.rotation().T + np.array(self.origin)


@dataclass(frozen=True)
class Placed:
    """One prop in the world.

    family: a prop family, or a fixture (`arm`, `twig`, `board`). asset: which member of the family. position:
    metres, of the prop's own origin. rotation: rotation vector (axis times radians), prop to world.
    role: `occluder` hides the object, `holder` carries one, `clutter` hides nothing.
    """

    family: str
    asset: int
    position: tuple[float, float, float]
    rotation: tuple[float, float, float]
    role: Role

    def matrix(self) -> np.ndarray:
        """Return prop to world, (3, 3) float64."""
        return _matrix(self.rotation)

    def shift(self, way: np.ndarray) -> "Placed":
        """Return the prop moved by (3,) metres."""
        x, y, z = (np.array(self.position) + way).tolist()
        return replace(self, position=(x, y, z))


@dataclass(frozen=True)
class Coat:
    """Covering of the object.

    Attributes:
        colours: Linear albedo of each of the object's parts.
        metal: Whether it mirrors in its own colour and scatters nothing.
        gloss: Factor of a glaze's mirror image, 0 for matt.
        roughness: Roughness of the mirror, in [0, 1].
        paint: Seed of a decoration; None for plain.
    """

    colours: tuple[tuple[float, float, float], ...]
    metal: bool
    gloss: float
    roughness: float
    paint: int | None

    @property
    def finish(self) -> str:
        """Return `metal`, `painted`, `glossy` or `matt`."""
        if self.metal or self.paint is not None:
            return "metal" if self.metal else "painted"
        return "glossy" if self.gloss else "matt"


@dataclass(frozen=True)
class Lens:
    """Difference of a photo's camera from the standard one of the object's class.

    Attributes:
        farther: Factor of distance and focal length: the same picture with less perspective.
        roll: Clockwise turn of the image, radians.
        scale: Factor of the focal length alone.
        shift: Shift of the picture to the right and down, in its sides.
    """

    farther: float = 1.0
    roll: float = 0.0
    scale: float = 1.0
    shift: tuple[float, float] = (0.0, 0.0)


@dataclass(frozen=True)
class SceneSpec:
    """One scene: the latents and everything else that is seen.

    shape (K,) standard deviations, of the model's shape nearest to the object's; design: number of the
    held-out design of the class whose deviation from the model the object also has, -1 for none.
    azimuth, elevation radians; albedo (3,) linear RGB; light (9,) SH of incident radiance, world frame,
    as the rasteriser has it. panorama: asset number; panorama_angle: radians by which it was turned.
    target: the requested occlusion, in [0, 0.9], or in the studio the measured one; occlusion: as measured by
    the sampler, one sample per pixel. rejected: number of rejected candidate placements, by reason. coat:
    None for a matt object of one albedo; else `albedo` is its mean. lens: the camera's.
    """

    seed: int
    index: int
    split: Split
    shape: tuple[float, ...]
    design: int
    azimuth: float
    elevation: float
    albedo: tuple[float, float, float]
    light: tuple[float, ...]
    panorama: int
    panorama_angle: float
    target: float
    occlusion: float
    room: Room
    props: tuple[Placed, ...]
    rejected: dict[str, int]
    coat: Coat | None = None
    lens: Lens = Lens()

    @property
    def finish(self) -> str:
        """Return the coat's finish; `matt` without one, and `painted` for a mesh's own materials."""
        plain = "painted" if self.room.layout < 0 else "matt"
        return plain if self.coat is None else self.coat.finish

    def latents(self) -> np.ndarray:
        """Return all latents (P,) float32 in the order of `vig.scene.Latents.to_vector`."""
        return np.array([*self.shape, self.azimuth, self.elevation, *self.albedo, *self.light], np.float32)

    def to_json(self) -> str:
        """Return one line of JSON that `from_json` reads back to an equal spec."""
        return json.dumps(self, default=vars, separators=(",", ":"))

    @staticmethod
    def from_json(text: str) -> "SceneSpec":
        """Return the inverse of `to_json`. Raises ValueError on anything else."""
        return decode(SceneSpec, parse_json(text))


@lru_cache(maxsize=256)
def _matrix(rotation: tuple[float, float, float]) -> np.ndarray:
    matrix = matrix_of(rotation)
    matrix.setflags(write=False)
    return matrix
