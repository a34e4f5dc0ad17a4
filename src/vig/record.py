"""explanation.json: its fields as types, from which the file, its JSON schema and tables of runs are made."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
import numpy as np
from msgspec import UNSET, Meta, UnsetType

from vig import __version__
from vig.inference import Fit, family_of
from vig.inference.settings import UNIFORM_TURN
from vig.io.checks import read_json, reading
from vig.photo import Window as PhotoWindow
from vig.scene import Camera as PhotoCamera
from vig.scene import Latents, ObjectClass, latent_layout
from vig.scene.object_class import axis_name

FILE = "explanation.json"
Probability = Annotated[float, Meta(ge=0, le=1)]
Two = Annotated[list[float], Meta(min_length=2, max_length=2)]
Three = Annotated[list[float], Meta(min_length=3, max_length=3)]
Four = Annotated[list[float], Meta(min_length=4, max_length=4)]
Six = Annotated[list[float], Meta(min_length=6, max_length=6)]
Nine = Annotated[list[float], Meta(min_length=9, max_length=9)]
Matrix3 = Annotated[list[Three], Meta(min_length=3, max_length=3)]
Matrix4 = Annotated[list[Four], Meta(min_length=4, max_length=4)]
Matrix6 = Annotated[list[Six], Meta(min_length=6, max_length=6)]
Albedo = Annotated[Three, Meta(description="linear RGB")]
Point = Annotated[Three, Meta(description="x, y in pixels; 1 where it is seen, else 0")]
Azimuth = Annotated[
    float, Meta(ge=0, le=360, description="degrees, of the camera; 0 on -Y, counter-clockwise")
]
Elevation = Annotated[float, Meta(ge=-90, le=90, description="degrees, of the camera above the horizon")]
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
    """Place, size and roll of the object in the window."""

    shift: Two
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
    """The user's hints; for masks and marks the number of pixels."""

    mask: int | UnsetType = UNSET
    marks: int | UnsetType = UNSET
    visible: bool | UnsetType = UNSET
    points: dict[str, Two] | UnsetType = UNSET
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
    azimuth_deg: Azimuth
    elevation_deg: Elevation
    albedo: Albedo
    light: Light
    shape: list[float]
    roll_deg: Roll
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
    trusted: list[Literal["view", "mask"]]
    hints: Hints
    # Files of earlier versions have none of these.
    points: dict[str, Point] | UnsetType = UNSET
    bounds: Annotated[list[Three], Meta(min_length=2, max_length=2)] | UnsetType = UNSET


def record(
    fit: Fit,
    object_class: ObjectClass,
    window: PhotoWindow,
    cameras: Sequence[PhotoCamera],
    focal_from: str,
    pinhole: tuple[np.ndarray, np.ndarray, np.ndarray],
    **others: Any,
) -> Explanation:
    """Return an explanation in plain numbers, degrees and linear RGB.

    Args:
        fit: Fit in the window.
        object_class: Class as which the photo was explained. Azimuth is 0 without deviation where any turn
            looks the same.
        window: The part of the photo that was fitted.
        cameras: Cameras of the whole photo, as the fit has it and as each alternative has.
        focal_from: Where the focal length is from; see `vig.Explanation`.
        pinhole: Intrinsics, pose and its covariance, as `vig.Explanation.pinhole_pose` has them.
        others: Fields of the record that follow from pictures of the photo's size, or from the user.
    """
    camera, turns = cameras[0], object_class.symmetry.fold
    deviation = latent_layout(object_class.shape_model.modes).split(fit.deviation)
    matrix, pose, covariance = pinhole
    most_deg = math.degrees(UNIFORM_TURN) / max(turns, 1)
    return Explanation(
        format=2,
        vig=__version__,
        class_=object_class.name,
        front=object_class.front,
        family=family_of(fit.latents.shape[0], object_class),
        verdict=fit.verdict.name.lower(),  # type: ignore[arg-type]
        reason=fit.reason,
        confidence=_none_if_nan(fit.confidence),
        present=_none_if_nan(fit.present),
        mask_confidence=_none_if_nan(fit.mask_confidence),
        trusted_from=TrustedFrom(_none_if_nan(fit.view_threshold), _none_if_nan(fit.mask_threshold)),
        **_numbers(fit.latents),
        roll_deg=_round_numbers(math.degrees(camera.roll)),
        deviation=Deviation(
            _round_numbers(min(math.degrees(deviation["azimuth"][0]), most_deg)) if turns else None,
            _round_numbers(math.degrees(deviation["elevation"][0])),
            *(_round_numbers(deviation[name]) for name in ("albedo", "light", "shape")),
        ),
        alternatives=[
            Alternative(
                probability=_none_if_nan(view.probability),
                behind_nats=_none_if_nan(view.score_gap),
                **_numbers(view.latents),
                roll_deg=_round_numbers(math.degrees(seen.roll)),
                K=seen.K.tolist(),
                camera_from_object=_pose(seen, view.latents),
            )
            for view, seen in zip(fit.alternatives, cameras[1:], strict=True)
        ],
        evidence_nats=_round_numbers(fit.evidence),
        start_evidence_nats=_round_numbers(fit.start_evidence),
        evaluations=fit.evaluations,
        window=Window(window.left, window.top, window.side),
        framing=Framing(
            _round_numbers(fit.framing[:2]),
            _round_numbers(math.exp(float(fit.framing[2]))),
            _round_numbers(math.degrees(fit.framing[3])),
        ),
        camera=Camera(
            camera.width,
            camera.height,
            camera.K.tolist(),
            _pose(camera, fit.latents),
            focal_from,  # type: ignore[arg-type]
            "metres of the class's usual size; a photo tells size and distance only as their ratio",
        ),
        pinhole=Pinhole(
            matrix.tolist(),
            pose.tolist(),
            covariance.tolist(),
            focal_from != "assumed" and object_class.size_known,
            **camera_from_mesh(pose, object_class),
        ),
        glb_from_object=glb_from_object(float(fit.latents.azimuth[0])).tolist(),
        frames={
            "object": "right-handed, metres, Z up, origin on the ground under it",
            "camera": "OpenCV: x right, y down, z forward, metres",
            "pixels": "x right, y down; the centre of the first pixel is (0.5, 0.5)",
            "object.glb": "stored positions are in the object's frame; its node, glb_from_object, turns them"
            " upright",
        }
        | ({"front": f"+X is {object_class.front}"} if object_class.front else {}),
        **others,
    )


def read_explanation(folder: Path, remedy: str = "Explain the photo anew with `vig fit`.") -> dict[str, Any]:
    """Read explanation.json of a folder of results; UserError, with a remedy, unless it is one."""
    path = folder / FILE
    with reading(path, "an explanation of `vig fit`", remedy):
        described: dict[str, Any] = read_json(path)
        msgspec.convert(described, Explanation)
        return described


def glb_from_object(azimuth: float) -> np.ndarray:
    """Return (4, 4): glTF's axes (Y up) from the object's (Z up), a camera at the azimuth (radians) on +Z.

    Viewers look from there.
    """
    cos, sin = math.cos(azimuth), math.sin(azimuth)
    y_up = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
    turn = np.array([[cos, sin, 0, 0], [-sin, cos, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
    stands: np.ndarray = y_up @ turn
    return stands


def camera_from_mesh(camera_from_object: np.ndarray, object_class: ObjectClass) -> dict[str, Any]:
    """Return the rigid pose (4, 4) of a class of one mesh in the coordinates and units of its file."""
    if object_class.object_from_mesh is None:
        return {}
    pose = camera_from_object @ object_class.object_from_mesh
    scale = float(np.cbrt(np.linalg.det(pose[:3, :3])))
    return {
        "camera_from_mesh": [*(pose[:3] / scale).tolist(), [0.0, 0.0, 0.0, 1.0]],
        "mesh_up": axis_name(object_class.object_from_mesh[2, :3]),
        "mesh_up_known": object_class.up_known,
    }


def _numbers(latents: Latents) -> dict[str, Any]:
    """Return the fields of one set of latents (B = 1)."""
    return {
        "azimuth_deg": _round_numbers(math.degrees(float(latents.azimuth[0])) % 360),
        "elevation_deg": _round_numbers(math.degrees(float(latents.elevation[0]))),
        "albedo": _round_numbers(latents.albedo[0]),
        "light": _round_numbers(latents.light[0]),
        "shape": _round_numbers(latents.shape[0]),
    }


def _pose(camera: PhotoCamera, latents: Latents) -> list[list[float]]:
    pose: list[list[float]] = camera.camera_from_object(latents).tolist()
    return pose


def _none_if_nan(value: float) -> float | None:
    """Return a number, None where it is NaN, hence unknown."""
    return None if math.isnan(value) else _round_numbers(value)


def _round_numbers(value: float | np.ndarray, digits: int = 5) -> Any:
    if isinstance(value, np.ndarray):
        return [round(number, digits) for number in value.tolist()]
    return round(float(value), digits)
