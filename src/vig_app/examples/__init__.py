"""Photos of partly hidden teapots, path-traced with Cycles, and their truth (README.md describes both)."""

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from safetensors.numpy import load_file

from vig.scene.latents import Latents

FOLDER = Path(__file__).parent


@dataclass(frozen=True, kw_only=True)
class PackagedPhoto:
    """A photo that comes with vig, and its truth.

    Attributes:
        name: Name of the file.
        class_name: Class to look for in it.
        photo: 8-bit sRGB file.
        visible_mask: 8-bit PNG, 255 where at least half of the pixel shows the object.
        amodal_mask: The same without the things before the object.
        occlusion: 1 - visible / amodal pixels, in [0, 1].
        vertices: (V, 3) float32, metres, the object's own, which the class's shape model does not reach.
    """

    name: str
    class_name: str
    photo: Path
    visible_mask: Path
    amodal_mask: Path
    occlusion: float
    vertices: np.ndarray


@dataclass(frozen=True, kw_only=True)
class Example(PackagedPhoto):
    """A PNG of 150 x 150 pixels, taken with `Camera.standard` of the class, and its truth.

    truth: One set of latents (B = 1); the light is that at the object's place with the object
    removed, and the shape the model's nearest to the object's.
    """

    truth: Latents


def described_photos(folder: Path, ending: str) -> list[tuple[dict[str, Any], dict[str, Any]]]:
    """Return truth.json's fields of each photo in a folder, and its fields of `PackagedPhoto` but class."""
    shapes = load_file(folder / "shapes.safetensors")
    described = json.loads((folder / "truth.json").read_text())
    return [
        (
            described | about,
            {
                "name": (name := about["name"]),
                "photo": folder / f"{name}.{ending}",
                "visible_mask": folder / "masks" / f"{name}_visible.png",
                "amodal_mask": folder / "masks" / f"{name}_amodal.png",
                "occlusion": about["occlusion"],
                "vertices": shapes[name].astype(np.float32),
            },
        )
        for about in described["photos"]
    ]


def example_photos() -> list[Example]:
    """Return the packaged examples, the least hidden first."""
    return [
        Example(
            **fields,
            class_name=about["class"],
            truth=Latents(
                shape=np.array([about["shape"]], np.float32),
                azimuth=np.array([math.radians(about["azimuth_deg"])], np.float32),
                elevation=np.array([math.radians(about["elevation_deg"])], np.float32),
                albedo=np.array([about["albedo"]], np.float32),
                light=np.array([about["light"]], np.float32),
            ),
        )
        for about, fields in described_photos(FOLDER, "png")
    ]
