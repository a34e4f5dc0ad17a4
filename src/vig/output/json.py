"""An explanation's numbers, and its folder of files: explanation.json, pictures, object.glb."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from vig import __version__
from vig.inference import Fit, family_of
from vig.inference.settings import UNIFORM_TURN
from vig.io.files import atomic_write
from vig.photo.window import Window
from vig.scene import Camera, Latents, ObjectClass, latent_layout
from vig.scene.object_class import axis_name

FORMAT = 2
"""Of explanation.json; docs/explanation.md describes it."""
Y_UP = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
"""glTF's axes (Y up) from the object's (Z up)."""
SCALE = "metres of the class's usual size; a photo tells size and distance only as their ratio"
FRAMES = {
    "object": "right-handed, metres, Z up, origin on the ground under it",
    "camera": "OpenCV: x right, y down, z forward, metres",
    "pixels": "x right, y down; the centre of the first pixel is (0.5, 0.5)",
    "object.glb": "stored positions are in the object's frame; its node, glb_from_object, turns them upright",
}


def glb_from_object(azimuth: float) -> np.ndarray:
    """(4, 4): Y up, and turned about the vertical so that an eye at the azimuth (radians) is on +Z.

    Viewers look from there.
    """
    cos, sin = math.cos(azimuth), math.sin(azimuth)
    turn = np.array([[cos, sin, 0, 0], [-sin, cos, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
    stands: np.ndarray = Y_UP @ turn
    return stands


def mask_picture(amodal: np.ndarray, visible: np.ndarray) -> np.ndarray:
    """(H, W) uint8 of two masks (H, W) bool: 255 where the object is visible, 128 where hidden, else 0."""
    picture: np.ndarray = amodal.view(np.uint8) * np.uint8(128)
    picture[visible] = 255
    return picture


def write_json(folder: Path, described: dict[str, Any], name: str = "explanation.json") -> None:
    """Write explanation.json, or what another file of a result's folder describes."""
    with atomic_write(folder / name) as temporary:
        Path(temporary).write_text(json.dumps(described, indent=2) + "\n")


def describe(
    fit: Fit,
    object_class: ObjectClass,
    window: Window,
    cameras: Sequence[Camera],
    focal_from: str,
    hidden: float | None,
    box: Sequence[int] | None,
    pinhole: tuple[np.ndarray, np.ndarray, np.ndarray],
) -> dict[str, Any]:
    """Return a window's fit in plain numbers, degrees and linear RGB, as `explanation.json` holds it.

    Args:
        fit: In the window.
        object_class: What the photo was explained as. Where any turn looks the same azimuth is 0 and has no
            deviation.
        window: The part of the photo that was fitted.
        cameras: Of the whole photo, as the fit has it and as each alternative has.
        focal_from: Where the focal length is from; see `Explanation`.
        hidden: Share of the object's pixels within the photo that are hidden, None when there are none.
        box: x, y, width, height in pixels round what the object covers, None for nothing.
        pinhole: Intrinsics, pose and its covariance, as `Explanation.pinhole_pose` has them.
    """
    camera = cameras[0]
    turns = object_class.symmetry.fold
    deviation = latent_layout(object_class.shape_model.modes).split(fit.deviation)
    return {
        "format": FORMAT,
        "vig": __version__,
        "class": object_class.name,
        "front": object_class.front,
        "family": family_of(fit.latents.shape[0], object_class),
        "verdict": fit.verdict.name.lower(),
        "reason": fit.reason,
        "confidence": _probability(fit.confidence),
        "present": _probability(fit.present),
        "mask_confidence": _probability(fit.mask_confidence),
        "trusted_from": {
            "view": _probability(fit.view_threshold),
            "mask": _probability(fit.mask_threshold),
        },
        **describe_latents(fit.latents),
        "roll_deg": _rounded(math.degrees(camera.roll)),
        "deviation": {
            "azimuth_deg": _rounded(
                min(math.degrees(deviation["azimuth"][0]), math.degrees(UNIFORM_TURN) / turns)
            )
            if turns
            else None,
            "elevation_deg": _rounded(math.degrees(deviation["elevation"][0])),
            **{name: _rounded(deviation[name]) for name in ("albedo", "light", "shape")},
        },
        "alternatives": [
            {
                "probability": _probability(view.probability),
                "behind_nats": _probability(view.behind),
                **describe_latents(view.latents),
                "roll_deg": _rounded(math.degrees(seen.roll)),
                "K": seen.K.tolist(),
                "camera_from_object": _pose(seen, view.latents).tolist(),
            }
            for view, seen in zip(fit.alternatives, cameras[1:], strict=True)
        ],
        "box": box and list(box),
        "hidden_fraction": None if hidden is None else _rounded(hidden),
        "evidence_nats": _rounded(fit.evidence),
        "start_evidence_nats": _rounded(fit.start_evidence),
        "evaluations": fit.evaluations,
        "window": {"left": window.left, "top": window.top, "side": window.side},
        "framing": {
            "shift": _rounded(fit.framing[:2]),
            "magnification": _rounded(math.exp(float(fit.framing[2]))),
            "roll_deg": _rounded(math.degrees(fit.framing[3])),
        },
        "camera": {
            "width": camera.width,
            "height": camera.height,
            "K": camera.K.tolist(),
            "camera_from_object": _pose(camera, fit.latents).tolist(),
            "focal_from": focal_from,
            "scale": SCALE,
        },
        "pinhole": {
            "K": pinhole[0].tolist(),
            "camera_from_object": pinhole[1].tolist(),
            "covariance": pinhole[2].tolist(),
            "distance_known": focal_from != "assumed" and object_class.size_known,
            **camera_from_mesh(pinhole[1], object_class),
        },
        "glb_from_object": glb_from_object(float(fit.latents.azimuth[0])).tolist(),
        "frames": FRAMES | ({"front": f"+X is {object_class.front}"} if object_class.front else {}),
    }


def camera_from_mesh(camera_from_object: np.ndarray, object_class: ObjectClass) -> dict[str, Any]:
    """The rigid pose (4, 4) of a class of one mesh in the coordinates and units of its file."""
    if object_class.object_from_mesh is None:
        return {}
    pose = camera_from_object @ object_class.object_from_mesh
    scale = float(np.cbrt(np.linalg.det(pose[:3, :3])))
    return {
        "camera_from_mesh": [*(pose[:3] / scale).tolist(), [0.0, 0.0, 0.0, 1.0]],
        "mesh_up": axis_name(object_class.object_from_mesh[2, :3]),
        "mesh_up_known": object_class.up_known,
    }


def _pose(camera: Camera, latents: Latents) -> np.ndarray:
    return camera.camera_from_world(float(latents.azimuth[0]), float(latents.elevation[0]))


def _probability(value: float) -> float | None:
    return None if math.isnan(value) else _rounded(value)


def describe_latents(latents: Latents) -> dict[str, Any]:
    """One set of latents (B = 1) in plain numbers."""
    return {
        "azimuth_deg": _rounded(math.degrees(float(latents.azimuth[0])) % 360),
        "elevation_deg": _rounded(math.degrees(float(latents.elevation[0]))),
        "albedo": _rounded(latents.albedo[0]),
        "light": _rounded(latents.light[0]),
        "shape": _rounded(latents.shape[0]),
    }


def _rounded(value: float | np.ndarray, digits: int = 5) -> Any:
    if isinstance(value, np.ndarray):
        return [round(number, digits) for number in value.tolist()]
    return round(value, digits)
