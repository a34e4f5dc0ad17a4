"""Things of the world: props, and furniture with the supports on which props stand."""

import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Generic, Literal, TypeVar, get_args

import numpy as np

from vig_world.assets.textures import Array
from vig_world.mesh import Mesh

Zone = Literal[
    "cooking", "dining", "drinks", "desk", "reading", "display", "storage", "bedside", "washing", "floor"
]
"""The functional zones of rooms."""
ZONE_NAMES: tuple[Zone, ...] = get_args(Zone)
ALIKE: dict[str, set[str]] = {
    "teapot": {"kettle"},
    "pot": {"kettle"},
    "mug": {"cup"},
    "cup": {"mug", "setting"},
    "glass": {"tumbler"},
    "car": {"vehicle"},
    "vehicle": {"car"},
    "truck": {"car"},
    "cat": {"animal"},
    "cow": {"animal"},
    "dog": {"animal"},
    "horse": {"animal"},
    "fourleg": {"animal"},
    "vase": {"jar"},
}
"""Words of props' families that look like a class, by a word of its name."""


@dataclass(frozen=True)
class Material:
    """A surface.

    Attributes:
        texture: (h, w, 3) float32 linear albedo, row 0 the top (v = 1), repeated outside [0, 1].
        kind: Its substance: ceramic, glass, metal, wood, paper, plastic, cloth, leaf, skin (of fruit), wax,
            earth.
        roughness: In [0, 1], 0 a mirror; for path tracers only.
        slot: A surface whose finish each sample chooses anew (`wall`, `floor`, `ceiling`, `wood`, `top`,
            `fabric`), the texture standing in for it; texture coordinates are metres there. Empty: it is
            kept.
        emission: Radiance that the surface emits (linear, 1 = white paper in the exposed picture).
    """

    texture: Array
    kind: str
    roughness: float
    slot: str = ""
    emission: float = 0.0


Parts = tuple[tuple[Mesh, Material], ...]  # meshes with texture coordinates, each with its material


@dataclass(frozen=True)
class Prop:
    """A household object, metres, standing on z = 0 with its bounding box centred at x = y = 0."""

    family: str
    parts: Parts


def prop(family: str, *parts: tuple[Mesh, Material]) -> Prop:
    """Return a Prop of the parts, shifted together to stand on z = 0 centred at x = y = 0."""
    points = np.concatenate([mesh.vertices for mesh, _ in parts]).astype(np.float64)
    low, high = points.min(0), points.max(0)
    origin = np.array([(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, low[2]])
    shifted = [
        (Mesh((mesh.vertices - origin).astype(np.float32), mesh.faces, mesh.uv), material)
        for mesh, material in parts
    ]
    return Prop(family, tuple(shifted))


@dataclass(frozen=True)
class Support:
    """A level rectangle on which things stand.

    Attributes:
        zone: Its use, which decides the things on it; one of `ZONE_NAMES`.
        centre: (x, y, z) metres.
        half: Half its extents along its own axes.
        turn: Radians about +Z from its owner's x axis to its own.
        clearance: Free metres above it (a shelf's next board); inf where nothing is above.
        behind: Metres from its edge at +y of its own axes to the wall, back or thing that closes that side,
            inf where it is open; -y is where people stand.
    """

    zone: str
    centre: tuple[float, float, float]
    half: tuple[float, float]
    turn: float = 0.0
    clearance: float = float("inf")
    behind: float = float("inf")

    def move(self, offset: tuple[float, float, float], turn: float) -> "Support":
        """Return the support after its owner was turned by `turn` radians about +Z and then shifted."""
        x, y, z = self.centre
        c, s = np.cos(turn), np.sin(turn)
        centre = (float(c * x - s * y + offset[0]), float(s * x + c * y + offset[1]), z + offset[2])
        return replace(self, centre=centre, turn=self.turn + turn)

    def stretch(self, x: float, y: float, z: float) -> "Support":
        """Return the support after its owner was stretched along its axes; turns are of quarters only."""
        along = (x, y) if abs(np.cos(self.turn)) > 0.5 else (y, x)
        centre = (self.centre[0] * x, self.centre[1] * y, self.centre[2] * z)
        half = (self.half[0] * along[0], self.half[1] * along[1])
        return Support(self.zone, centre, half, self.turn, self.clearance * z, self.behind * along[1])


@dataclass(frozen=True)
class Furniture:
    """A piece of furniture, metres, standing on z = 0 with its bounding box centred at x = y = 0.

    Its front, from which it is used, faces -Y.
    """

    family: str
    parts: Parts
    supports: tuple[Support, ...]


Content = TypeVar("Content")


@dataclass(frozen=True, eq=False)
class AssetModel(Generic[Content]):
    """A prop or a piece of furniture of a catalogue, packaged or a user's own.

    Attributes:
        name: Path of its file, relative to its folder, or name of its row in the packaged table.
        family: Its kind, such as `mug`; things like an object's class are not shown with it.
        fingerprint: sha256 of all files it was read from and of its settings in `vig.toml`; "" if packaged.
        read: Reads it.
        zones: Zones to which a prop belongs; empty: any.
        varies: Whether samples show it in other proportions and colours.
    """

    name: str
    family: str
    fingerprint: str
    read: Callable[[], Content]
    zones: tuple[str, ...] = ()
    varies: bool = False


PropModel = AssetModel[Parts]
FurnitureModel = AssetModel[Furniture]


def is_of_class(family: str, name: str) -> bool:
    """Return whether a prop's family or file, such as `mug`, is named like a class or known to be alike."""
    words, own = _words(name), _words(family)
    return bool(own & words) or any(own & ALIKE.get(word, set()) for word in words)


def _words(text: str) -> set[str]:
    """Return the words of a name, in small letters and singular."""
    return {word.removesuffix("s") for word in re.split(r"[^a-z]+", text.lower())} - {""}
