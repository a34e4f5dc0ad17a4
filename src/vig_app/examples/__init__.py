"""Photos of partly hidden teapots, path-traced with Cycles, and their truth (README.md says how made)."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from safetensors.numpy import load_file

from vig.scene.latents import Latents

FOLDER = Path(__file__).parent


@dataclass(frozen=True)
class Example:
    """A photo and everything that is true of it.

    photo: 8-bit sRGB PNG, 150 x 150, taken with `Camera.standard` of the class. visible_mask, amodal_mask:
    8-bit grey PNGs, 255 where at least half of the pixel shows the object, and where it would without
    occluders. truth: one set of latents (B = 1); the light is what arrives at the object's place with the
    object removed, and the shape the model's nearest to the object's. vertices: (V, 3) float32, metres, the
    object's own, which the model does not reach.
    occlusion: 1 - visible / amodal pixels, in [0, 1].
    """

    name: str
    class_name: str
    photo: Path
    visible_mask: Path
    amodal_mask: Path
    truth: Latents
    vertices: np.ndarray
    occlusion: float


def example_photos() -> list[Example]:
    """The packaged examples, the least hidden first."""
    described = json.loads((FOLDER / "truth.json").read_text())
    shapes = load_file(FOLDER / "shapes.safetensors")
    return [_example(about, described["class"], shapes[about["name"]]) for about in described["photos"]]


def _example(about: dict, class_name: str, vertices: np.ndarray) -> Example:
    name = about["name"]
    truth = Latents(
        shape=np.array([about["shape"]], np.float32),
        azimuth=np.array([math.radians(about["azimuth_deg"])], np.float32),
        elevation=np.array([math.radians(about["elevation_deg"])], np.float32),
        albedo=np.array([about["albedo"]], np.float32),
        light=np.array([about["light"]], np.float32),
    )
    return Example(
        name=name,
        class_name=class_name,
        photo=FOLDER / f"{name}.png",
        visible_mask=FOLDER / "masks" / f"{name}_visible.png",
        amodal_mask=FOLDER / "masks" / f"{name}_amodal.png",
        truth=truth,
        vertices=vertices,
        occlusion=about["occlusion"],
    )
