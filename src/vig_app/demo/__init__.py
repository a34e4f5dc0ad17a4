"""The photos that `vig demo` explains, path traced, and their truth (README.md says how they were made)."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from safetensors.numpy import load_file

FOLDER = Path(__file__).parent


@dataclass(frozen=True)
class DemoPhoto:
    """A photo, what it is asked for, and what is true of it.

    Attributes:
        name: Of the file.
        title: What is to be seen, in words.
        class_name: What vig looks for in it.
        shows: The class of the object in it; where that is another one, vig has to say so.
        photo: 8-bit sRGB JPEG, 800 x 800.
        visible_mask: 8-bit PNG, 255 where at least half of the pixel shows the object.
        amodal_mask: The same without what is before the object.
        azimuth_deg, elevation_deg: Of the eye, in degrees.
        albedo: (3,) mean of the object, linear RGB.
        occlusion: 1 - visible / amodal pixels, in [0, 1].
        vertices: (V, 3) float32, metres, the object's own, which the class's shape model does not reach.
    """

    name: str
    title: str
    class_name: str
    shows: str
    photo: Path
    visible_mask: Path
    amodal_mask: Path
    azimuth_deg: float
    elevation_deg: float
    albedo: tuple[float, ...]
    occlusion: float
    vertices: np.ndarray

    @property
    def present(self) -> bool:
        """Whether the photo shows what it is asked for."""
        return self.class_name == self.shows


def demo_photos() -> list[DemoPhoto]:
    """The packaged photos, in the order in which they are shown."""
    described = json.loads((FOLDER / "truth.json").read_text())
    shapes = load_file(FOLDER / "shapes.safetensors")
    return [_photo(about, shapes[about["name"]].astype(np.float32)) for about in described["photos"]]


def _photo(about: dict, vertices: np.ndarray) -> DemoPhoto:
    name = about["name"]
    return DemoPhoto(
        name=name,
        title=about["title"],
        class_name=about["asked"],
        shows=about["shows"],
        photo=FOLDER / f"{name}.jpg",
        visible_mask=FOLDER / "masks" / f"{name}_visible.png",
        amodal_mask=FOLDER / "masks" / f"{name}_amodal.png",
        azimuth_deg=about["azimuth_deg"],
        elevation_deg=about["elevation_deg"],
        albedo=tuple(about["albedo"]),
        occlusion=about["occlusion"],
        vertices=vertices,
    )
