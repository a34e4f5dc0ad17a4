"""An explanation as files: explanation.json, overlay.png, mask.png, object.glb."""

from __future__ import annotations

import json
import math
import struct
from pathlib import Path
from typing import Any

import numpy as np
import torch

from vig import __version__
from vig.files import atomic_write
from vig.inference import Fit
from vig.photo.images import write_png
from vig.photo.window import Window
from vig.scene import Camera, Latents, ObjectClass, latent_layout

OUTLINE = np.array([255, 210, 0], np.uint8)
HIDDEN = np.array([235, 40, 120], np.float32)
HIDDEN_SHARE = 0.5


def overlay(photo: np.ndarray, amodal: np.ndarray, visible: np.ndarray) -> np.ndarray:
    """The photo with the object's whole outline in yellow and its hidden pixels tinted pink.

    photo (H, W, 3) uint8 sRGB; amodal, visible (H, W) bool. Result (H, W, 3) uint8. The outline's width
    grows with the photo.
    """
    picture, hidden = photo.copy(), amodal & ~visible
    picture[hidden] = ((1 - HIDDEN_SHARE) * picture[hidden] + HIDDEN_SHARE * HIDDEN).round()
    grown = amodal.copy()
    for _ in range(max(1, round(min(photo.shape[:2]) / 200))):
        before = grown.copy()
        for here, there in ((np.s_[1:], np.s_[:-1]), (np.s_[:, 1:], np.s_[:, :-1])):
            grown[here] |= before[there]
            grown[there] |= before[here]
    picture[grown & ~amodal] = OUTLINE
    return picture


def write_explanation(
    folder: Path,
    described: dict[str, Any],
    picture: np.ndarray,
    amodal: np.ndarray,
    visible: np.ndarray,
    latents: Latents,
    object_class: ObjectClass,
) -> None:
    """Write the files of one explained photo into `folder`, which is made when it is missing.

    explanation.json holds `described` (see `describe`), overlay.png the `picture` (H, W, 3) uint8. mask.png
    is 255 where the object is `visible` (H, W) bool, 128 where only `amodal` (H, W) bool holds, 0 elsewhere.
    object.glb is the mesh of `latents` (B = 1).
    """
    write_png(folder / "overlay.png", picture)
    write_png(folder / "mask.png", np.where(visible, np.uint8(255), amodal * np.uint8(128)))
    write_glb(folder / "object.glb", latents, object_class)
    with atomic_write(folder / "explanation.json") as temporary:
        Path(temporary).write_text(json.dumps(described, indent=2) + "\n")


def describe(
    fit: Fit, object_class: ObjectClass, window: Window, camera: Camera, hidden: float | None
) -> dict[str, Any]:
    """Return a window's fit in plain numbers, degrees and linear RGB, as `explanation.json` holds it.

    `camera` is that of the whole photo; `hidden` the share of the object's pixels within the photo that are
    hidden, None when there are none. Where any turn looks the same azimuth is 0 and has no deviation.
    """
    turns = object_class.symmetry.fold
    deviation = latent_layout(object_class.shape_model.modes).split(fit.deviation)
    pose = camera.camera_from_world(float(fit.latents.azimuth), float(fit.latents.elevation))
    return {
        "vig": __version__,
        "class": object_class.name,
        "front": object_class.front,
        "verdict": fit.verdict.name.lower(),
        "reason": fit.reason,
        "confidence": None if math.isnan(fit.confidence) else _rounded(fit.confidence),
        **describe_latents(fit.latents),
        "roll_deg": _rounded(math.degrees(camera.roll)),
        "alternative": fit.alternative and describe_latents(fit.alternative),
        "deviation": {
            "azimuth_deg": _rounded(math.degrees(deviation["azimuth"])) if turns else None,
            "elevation_deg": _rounded(math.degrees(deviation["elevation"])),
            **{name: _rounded(deviation[name]) for name in ("albedo", "light", "shape")},
        },
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
            "camera_from_object": pose.tolist(),
        },
    }


def describe_latents(latents: Latents) -> dict[str, Any]:
    """One set of latents (B = 1) in plain numbers."""
    return {
        "azimuth_deg": _rounded(math.degrees(float(latents.azimuth)) % 360),
        "elevation_deg": _rounded(math.degrees(float(latents.elevation))),
        "albedo": _rounded(latents.albedo[0]),
        "light": _rounded(latents.light[0]),
        "shape": _rounded(latents.shape[0]),
    }


def write_glb(path: Path, latents: Latents, object_class: ObjectClass) -> None:
    """The explained object as a GLB: metres, Y up as glTF wants, its albedo as a matte base colour."""
    model = object_class.shape_model
    z_up = model.vertices(latents.shape)[0].numpy()
    vertices = np.stack([z_up[:, 0], z_up[:, 2], -z_up[:, 1]], axis=1)
    # By hand: to load a library for it takes half a second of each start of `vig fit`.
    indices, points = model.faces.astype("<u4"), vertices.astype("<f4")
    surface = {
        "baseColorFactor": [*latents.albedo[0].tolist(), 1.0],
        "metallicFactor": 0,
        "roughnessFactor": 1,
    }
    primitive = {"attributes": {"POSITION": 1}, "indices": 0, "material": 0}
    bounds = {"min": points.min(0).tolist(), "max": points.max(0).tolist()}
    described = {
        "asset": {"version": "2.0", "generator": f"vig {__version__}"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"name": object_class.name, "mesh": 0}],
        "meshes": [{"name": object_class.name, "primitives": [primitive]}],
        "materials": [{"name": "albedo", "pbrMetallicRoughness": surface}],
        "accessors": [
            {"bufferView": 0, "componentType": 5125, "count": indices.size, "type": "SCALAR"},
            {"bufferView": 1, "componentType": 5126, "count": len(points), "type": "VEC3"} | bounds,
        ],
        "bufferViews": [
            {"buffer": 0, "byteLength": indices.nbytes, "target": 34963},
            {"buffer": 0, "byteLength": points.nbytes, "target": 34962, "byteOffset": indices.nbytes},
        ],
        "buffers": [{"byteLength": indices.nbytes + points.nbytes}],
    }
    text = json.dumps(described).encode()
    parts = (b"JSON", text + b" " * (-len(text) % 4)), (b"BIN\0", indices.tobytes() + points.tobytes())
    body = b"".join(struct.pack("<I4s", len(data), kind) + data for kind, data in parts)
    with atomic_write(path) as temporary:
        Path(temporary).write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body)


def _rounded(value: float | torch.Tensor, digits: int = 5) -> Any:
    if isinstance(value, torch.Tensor):
        return [round(number, digits) for number in value.tolist()]
    return round(value, digits)
