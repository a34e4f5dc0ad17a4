"""Data that report.html draws by WebGL: the object's mesh, and each view's and step's difference from it.

Numbers are quantised to far less than a pixel and travel as base64; templates/page.html reads them.
"""

import base64
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from vig.explanation import Explanation
from vig.scene import Camera, Latents
from vig_app.pictures import part_albedo
from vig_app.report import words

STEPS = 8  # steps of the fit that a page shows at most
NEAREST = 0.5  # near plane, of the depth of the object's nearest vertex; it ends as much beyond the farthest


@dataclass(frozen=True)
class Pose:
    """Pose of a picture: `words` describe it, latents (B = 1) and framing (4,) place the object."""

    words: str
    latents: Latents
    framing: np.ndarray


def views_of(explanation: Explanation) -> list[Pose]:
    """Return the fit and its alternatives."""
    fit = explanation.fit
    first = Pose("this fit: " + words.view_words(fit.latents, fit.confidence), fit.latents, fit.framing)
    return [first] + [
        Pose(words.view_words(view.latents, view.probability), view.latents, view.framing)
        for view in fit.alternatives
    ]


def steps_of(explanation: Explanation) -> Iterable[Pose]:
    """Yield some steps of the fit that moved, the first and the last among them."""
    path = explanation.fit.descent
    moved = np.flatnonzero(np.concatenate([[True], (path[1:] != path[:-1]).any(1)]))
    for number in moved[np.unique(np.linspace(0, len(moved) - 1, STEPS).round().astype(int))].tolist():
        latents = Latents.from_vector(path[number : number + 1, :-4])
        text = f"step {number} of {len(path) - 1}: {words.view_words(latents, math.nan)}"
        yield Pose(text, latents, path[number, -4:])


def mesh_data(explanation: Explanation) -> dict[str, Any]:
    """Return the mesh of all poses: corners of faces, vertices of the fit in 16 bits, colours of parts."""
    object_class, vertices = explanation.object_class, explanation.vertices
    model = object_class.shape_model
    low, extent = vertices.min(0), np.ptp(vertices, axis=0)
    steps = np.where(extent > 0, extent, 1.0) / 65535
    small = len(vertices) <= 1 << 16
    return {
        "faces": _base64(model.faces, "<u2" if small else "<u4"),
        "bytes": 2 if small else 4,
        "vertices": _base64(((vertices - low) / steps).round(), "<u2"),
        "low": low.tolist(),
        "steps": steps.tolist(),
        "parts": _base64(model.parts, "<u2"),
        "colours": (part_albedo(explanation) / object_class.reflectance_of_parts[:, None]).tolist(),
        "reflectance": None if object_class.part_reflectance is None else list(object_class.part_reflectance),
        "target": (low + extent / 2).tolist(),
        "size": float(extent.max()),
    }


def pose_data(explanation: Explanation, poses: Sequence[Pose]) -> list[dict[str, Any]]:
    """Return the data of each pose beside `mesh_data`; see `_differences` for its vertices and light.

    `clip` takes vertices to OpenGL's clip space of the window, by columns.
    """
    latents = Latents.from_vector(np.concatenate([pose.latents.to_vector() for pose in poses]))
    standard = explanation.object_class.camera(camera_distance_ratio=explanation.camera_distance_ratio)
    drawn = []
    for pose, vertices, shadow in zip(poses, *_differences(explanation, latents), strict=True):
        angles = float(pose.latents.azimuth[0]), float(pose.latents.elevation[0])
        camera = standard.apply_framing(*pose.framing.tolist())
        drawn.append(
            {
                "words": pose.words,
                "azimuth": angles[0],
                "elevation": angles[1],
                "clip": clip_matrix(camera, camera.camera_from_world(*angles), explanation.vertices),
                "albedo": pose.latents.albedo[0].tolist(),
                "light": pose.latents.light[0].tolist(),
                "vertices": vertices,
                "shadow": shadow,
            }
        )
    return drawn


def clip_matrix(camera: Camera, pose: np.ndarray, vertices: np.ndarray) -> list[float]:
    """Return (16,) by columns: clip coordinates of OpenGL from the object's frame.

    Args:
        camera: Camera whose picture fills the canvas.
        pose: (4, 4) camera_from_object.
        vertices: (V, 3) between which and the camera, and beyond which, there is room.
    """
    depth = vertices @ pose[2, :3] + pose[2, 3]
    near, far = NEAREST * max(float(depth.min()), 1e-3), (2 - NEAREST) * float(depth.max())
    matrix = camera.K
    projection = np.array(
        [
            [2 * matrix[0, 0] / camera.width, 0, 2 * matrix[0, 2] / camera.width - 1, 0],
            [0, -2 * matrix[1, 1] / camera.height, 1 - 2 * matrix[1, 2] / camera.height, 0],
            [0, 0, (far + near) / (far - near), -2 * far * near / (far - near)],
            [0, 0, 1, 0],
        ]
    )
    return [float(f"{number:.7g}") for number in (projection @ pose).T.ravel()]


def _differences(
    explanation: Explanation, latents: Latents
) -> tuple[list[dict[str, Any] | None], list[dict[str, Any] | None]]:
    """Return for B poses the vertices (V, 3) less the fit's, and self-shadowing's irradiance (V,).

    Each is rounded to 8 bits of its own largest number; None where all are 0.
    """
    object_class = explanation.object_class
    basis = object_class.shape_model.basis
    moved = (latents.shape - explanation.latents.shape) @ basis.reshape(len(basis), -1)
    vertices = [_in_8_bits(row) for row in moved]
    if object_class.transfer is None:
        return vertices, [None] * len(vertices)
    # The sum over components before that over lobes, as `vig.renderer.drawing.vertex_irradiance` has it.
    weights = np.concatenate([np.ones((len(vertices), 1), np.float32), latents.shape], axis=1)
    lobes = (weights @ object_class.transfer.reshape(len(basis) + 1, -1)).reshape(len(vertices), -1, 9)
    added = (lobes @ latents.light[:, :, None])[..., 0]
    return vertices, [_in_8_bits(row) for row in added]


def _in_8_bits(numbers: np.ndarray) -> dict[str, Any] | None:
    """Return numbers as whole multiples of a step, -127 to 127; None where all are 0."""
    most = float(np.abs(numbers).max())
    return {"step": most / 127, "numbers": _base64((numbers * (127 / most)).round(), "i1")} if most else None


def _base64(array: np.ndarray, kind: str) -> str:
    return base64.b64encode(np.ascontiguousarray(array.astype(kind)).tobytes()).decode()
