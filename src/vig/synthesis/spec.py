"""What a synthetic scene is made of, as plain data: enough to build it again, with either renderer."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from typing import Any, Literal

import numpy as np

Split = Literal["train", "test"]
SPLITS: tuple[Split, ...] = ("train", "test")
Role = Literal["occluder", "holder", "clutter"]
Cause = Literal["none", "occluder"]


@dataclass(frozen=True)
class Surface:
    """A textured finish of the room: texture kind, its asset number, metres per repeat."""

    kind: str
    asset: int
    metres: float


@dataclass(frozen=True)
class Room:
    """A box of four walls, a floor and a ceiling, and perhaps a table, round an object at the origin.

    support: what the object stands on, at z = 0. heading: radians about +Z of the first wall's direction.
    walls: metres from the origin to the four walls, at heading + k * 90 degrees. table: metres from the
    origin to the four edges of the table top, same directions; empty when the object stands on the floor.
    floor_z, ceiling_z, thickness (of the table top): metres.
    """

    support: Literal["table", "floor"]
    heading: float
    walls: tuple[float, ...]
    table: tuple[float, ...]
    thickness: float
    floor_z: float
    ceiling_z: float
    floor: Surface
    wall: Surface
    table_top: Surface

    def extents(self) -> tuple[float, ...]:
        """Metres from the origin to the four ends of the surface on which things stand."""
        return self.table or self.walls

    def directions(self) -> np.ndarray:
        """Unit vectors (4, 2) in the ground plane towards the four walls."""
        angle = self.heading + np.arange(4) * (np.pi / 2)
        return np.stack([np.cos(angle), np.sin(angle)], axis=1)


@dataclass(frozen=True)
class Placed:
    """One prop in the world.

    family: a prop family, or a holder (`arm`, `board`, `cord`). asset: which member of the family. position:
    metres, of the prop's own origin. rotation: rotation vector (axis times radians), prop to world.
    role: `occluder` hides the object, `holder` carries one, `clutter` hides nothing.
    """

    family: str
    asset: int
    position: tuple[float, float, float]
    rotation: tuple[float, float, float]
    role: Role


@dataclass(frozen=True)
class SceneSpec:
    """One scene: the 24 latents and everything else that is seen.

    shape (K,) standard deviations; azimuth, elevation radians; albedo (3,) linear RGB; light (9,) SH of
    incident radiance, world frame. panorama: asset number; panorama_angle: radians by which it was turned.
    target: the occlusion asked for, in [0, 0.9]; occlusion: what the layout measured at low resolution.
    rejected: how many candidate placements were thrown away, by reason.
    """

    seed: int
    index: int
    split: Split
    shape: tuple[float, ...]
    azimuth: float
    elevation: float
    albedo: tuple[float, float, float]
    light: tuple[float, ...]
    panorama: int
    panorama_angle: float
    target: float
    occlusion: float
    cause: Cause
    room: Room
    props: tuple[Placed, ...]
    rejected: dict[str, int]

    def latents(self) -> np.ndarray:
        """All latents (P,) float32 in the order of `vig.scene.Latents.to_vector`."""
        return np.array([*self.shape, self.azimuth, self.elevation, *self.albedo, *self.light], np.float32)

    def to_json(self) -> str:
        """One line of JSON that `from_json` reads back to an equal spec."""
        return json.dumps(asdict(self), separators=(",", ":"))

    @staticmethod
    def from_json(text: str) -> SceneSpec:
        """The inverse of `to_json`. Raises KeyError, TypeError or ValueError on anything else."""
        data = json.loads(text)
        room = _tuples(data.pop("room"))
        for name in ("floor", "wall", "table_top"):
            room[name] = Surface(**room[name])
        props = tuple(Placed(**_tuples(prop)) for prop in data.pop("props"))
        return SceneSpec(**_tuples(data), room=Room(**room), props=props)


def _tuples(data: dict[str, Any]) -> dict[str, Any]:
    return {key: tuple(value) if isinstance(value, list) else value for key, value in data.items()}
