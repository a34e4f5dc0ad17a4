"""An explanation as files: explanation.json, overlay.png, mask.png, object.glb."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import torch
import trimesh

from vig import __version__
from vig.files import atomic_write
from vig.inference import Explanation
from vig.photo.images import write_png
from vig.photo.window import Window
from vig.report.overlay import overlay
from vig.scene import Latents, ObjectClass, latent_layout, srgb8_from_linear


def write_explanation(
    folder: Path, photo: np.ndarray, window: Window, explanation: Explanation, object_class: ObjectClass
) -> dict[str, Any]:
    """Write the files of one explained photo; returns what stands in the JSON.

    photo (H, W, 3) linear RGB, the whole one; the explanation is of its window. mask.png is 255 where the
    object is visible, 128 where it is hidden, 0 elsewhere.
    """
    height, width = photo.shape[:2]
    amodal = window.back(explanation.amodal.float().numpy(), width, height) > 0.5
    visible = (window.back(explanation.mask.float().numpy(), width, height) > 0.5) & amodal
    covered = int(amodal.sum())
    hidden = 1 - int(visible.sum()) / covered if covered else None
    described = describe(explanation, object_class, window, hidden)
    write_png(folder / "overlay.png", overlay(srgb8_from_linear(photo), amodal, visible))
    write_png(folder / "mask.png", np.where(visible, 255, np.where(amodal, 128, 0)).astype(np.uint8))
    write_glb(folder / "object.glb", explanation.latents, object_class)
    with atomic_write(folder / "explanation.json") as temporary:
        Path(temporary).write_text(json.dumps(described, indent=2) + "\n")
    return described


def describe(
    explanation: Explanation, object_class: ObjectClass, window: Window, hidden: float | None
) -> dict[str, Any]:
    """The explanation in plain numbers: degrees, linear RGB; see `explanation.json`.

    hidden: share of the object's pixels within the photo that are hidden, None when there are none.
    """
    latents = explanation.latents
    modes = object_class.shape_model.modes
    numbers = dict(zip(latent_layout(modes).labels, explanation.deviation.tolist(), strict=True))
    return {
        "vig": __version__,
        "class": object_class.name,
        "verdict": explanation.verdict.name.lower(),
        "reason": explanation.reason,
        "confidence": None if math.isnan(explanation.confidence) else _rounded(explanation.confidence),
        **describe_latents(latents),
        "alternative": explanation.alternative and describe_latents(explanation.alternative),
        "deviation": {
            "azimuth_deg": _rounded(math.degrees(numbers["azimuth"])),
            "elevation_deg": _rounded(math.degrees(numbers["elevation"])),
            "albedo": [_rounded(numbers[f"albedo_{c}"]) for c in "rgb"],
            "light": [_rounded(v) for k, v in numbers.items() if k.startswith("light")],
            "shape": [_rounded(v) for k, v in numbers.items() if k.startswith("shape")],
        },
        "hidden_fraction": None if hidden is None else _rounded(hidden),
        "evidence_nats": _rounded(explanation.evidence),
        "start_evidence_nats": _rounded(explanation.start_evidence),
        "evaluations": explanation.evaluations,
        "window": {"left": window.left, "top": window.top, "side": window.side},
        "framing": {
            "shift": _rounded(explanation.framing[:2]),
            "magnification": _rounded(math.exp(float(explanation.framing[2]))),
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
    colour = [*latents.albedo[0].tolist(), 1.0]
    material = trimesh.visual.material.PBRMaterial(
        name="albedo", baseColorFactor=(np.array(colour) * 255).round().astype(np.uint8), metallicFactor=0.0
    )
    material.roughnessFactor = 1.0
    mesh = trimesh.Trimesh(vertices, model.faces, process=False)
    mesh.visual = trimesh.visual.TextureVisuals(material=material)
    scene = trimesh.Scene()
    scene.add_geometry(mesh, geom_name=object_class.name)
    with atomic_write(path) as temporary:
        Path(temporary).write_bytes(scene.export(file_type="glb"))


def _rounded(value: float | torch.Tensor, digits: int = 5) -> Any:
    if isinstance(value, torch.Tensor):
        return [round(number, digits) for number in value.tolist()]
    return round(value, digits)
