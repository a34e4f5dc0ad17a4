"""What explanation.json holds, as types from which `vig schema explanation` makes its JSON schema."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
from msgspec import UNSET, Meta, UnsetType

from vig.io.checks import read_json, reading

DIALECT = "https://json-schema.org/draft/2020-12/schema"
Probability = Annotated[float, Meta(ge=0, le=1)]
Three = Annotated[list[float], Meta(min_length=3, max_length=3)]
Nine = Annotated[list[float], Meta(min_length=9, max_length=9)]
Matrix3 = Annotated[list[Three], Meta(min_length=3, max_length=3)]
Matrix4 = Annotated[
    list[Annotated[list[float], Meta(min_length=4, max_length=4)]], Meta(min_length=4, max_length=4)
]
Matrix6 = Annotated[
    list[Annotated[list[float], Meta(min_length=6, max_length=6)]], Meta(min_length=6, max_length=6)
]
Albedo = Annotated[Three, Meta(description="linear RGB")]
Azimuth = Annotated[float, Meta(ge=0, le=360, description="degrees, of the eye; 0 on -Y, counter-clockwise")]
Elevation = Annotated[float, Meta(ge=-90, le=90, description="degrees, of the eye above the horizon")]
Roll = Annotated[float, Meta(description="degrees, by which the photo is turned clockwise")]
Light = Annotated[Nine, Meta(description="spherical harmonics of incident radiance, world frame")]
Pose = Annotated[Matrix4, Meta(description="camera_from_object, metres; OpenCV: x right, y down, z forward")]


class TrustedFrom(msgspec.Struct):
    """Confidences from which a view and a mask are trusted, null where there is no calibration."""

    view: Probability | None
    mask: Probability | None


class Deviation(msgspec.Struct):
    """Standard deviations; of azimuth null where any turn looks the same."""

    azimuth_deg: float | None
    elevation_deg: float
    albedo: Three
    light: Nine
    shape: list[float]


class Alternative(msgspec.Struct):
    """Another view within reach of the evidence."""

    probability: Probability | None
    behind_nats: float | None
    azimuth_deg: Azimuth
    elevation_deg: Elevation
    albedo: Albedo
    light: Light
    shape: list[float]
    roll_deg: Roll
    K: Matrix3
    camera_from_object: Pose


class Window(msgspec.Struct):
    """The square of the photo that was fitted, pixels."""

    left: float
    top: float
    side: float


class Framing(msgspec.Struct):
    """How the object lies in the window."""

    shift: Annotated[list[float], Meta(min_length=2, max_length=2)]
    magnification: float
    roll_deg: float


class Camera(msgspec.Struct):
    """The camera that explains the photo; where no focal length is known it looks straight at the object."""

    width: int
    height: int
    K: Matrix3
    camera_from_object: Pose
    focal_from: Literal["given", "exif", "assumed"]
    scale: str


class Pinhole(msgspec.Struct):
    """The pose before the camera that took the photo; covariance of x, y, z (metres) and turns (radians)."""

    K: Matrix3
    camera_from_object: Pose
    covariance: Matrix6
    distance_known: bool
    camera_from_mesh: Matrix4 | UnsetType = UNSET
    mesh_up: Literal["+x", "-x", "+y", "-y", "+z", "-z"] | UnsetType = UNSET
    mesh_up_known: bool | UnsetType = UNSET


class Hints(msgspec.Struct):
    """What the user gave; of masks and marks the number of pixels."""

    mask: int | UnsetType = UNSET
    marks: int | UnsetType = UNSET
    visible: bool | UnsetType = UNSET
    points: dict[str, Annotated[list[float], Meta(min_length=2, max_length=2)]] | UnsetType = UNSET
    azimuth_deg: float | UnsetType = UNSET
    elevation_deg: float | UnsetType = UNSET
    roll_deg: float | UnsetType = UNSET
    pose: Matrix4 | UnsetType = UNSET


class Explanation(msgspec.Struct):
    """explanation.json of vig, format 2; docs/explanation.md describes each field."""

    format: Literal[2]
    vig: str
    class_: str = msgspec.field(name="class")
    front: str
    family: str | None
    verdict: Literal["trusted", "reverted", "ambiguous", "failed", "absent"]
    reason: str
    confidence: Probability | None
    present: Probability | None
    mask_confidence: Probability | None
    trusted_from: TrustedFrom
    trusted: list[Literal["view", "mask"]]
    azimuth_deg: Azimuth
    elevation_deg: Elevation
    roll_deg: Roll
    albedo: Albedo
    light: Light
    shape: list[float]
    deviation: Deviation
    alternatives: list[Alternative]
    box: Annotated[list[int], Meta(min_length=4, max_length=4, description="x, y, width, height")] | None
    hidden_fraction: Probability | None
    evidence_nats: float
    start_evidence_nats: float
    evaluations: int
    window: Window
    framing: Framing
    camera: Camera
    pinhole: Pinhole
    glb_from_object: Matrix4
    frames: dict[str, str]
    hints: Hints


def read_explanation(folder: Path, remedy: str = "Explain the photo anew with `vig fit`.") -> dict[str, Any]:
    """Read explanation.json of a folder of results; UserError, with a remedy, unless it is one."""
    path = folder / "explanation.json"
    with reading(path, "an explanation of `vig fit`", remedy):
        described: dict[str, Any] = read_json(path)
        msgspec.convert(described, Explanation)
        return described


SCHEMAS = {"explanation": Explanation}
"""Files by the names that `vig schema` takes."""


def schema_of(name: str) -> dict[str, Any]:
    """The JSON schema of a file that vig writes."""
    return {"$schema": DIALECT, "title": f"{name}.json of vig"} | msgspec.json.schema(SCHEMAS[name])
