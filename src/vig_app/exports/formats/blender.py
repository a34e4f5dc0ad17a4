"""Blender: a script that makes a scene of the object, the photo's camera and background, and the light."""

import math
from pathlib import Path

import numpy as np

from vig.explanation import Explanation
from vig.io.files import atomic_write, write_bytes, write_json
from vig.photo.images import as_srgb, write_png
from vig.scene import rotate_z
from vig.scene.light import sh_basis
from vig_app.glb import bake, write_object

FILES = tuple(f"blender/{name}" for name in "scene.py scene.json object.glb photo.png light.npy".split())


def write(folder: Path, explanation: Explanation) -> None:
    """Write the script and what it reads."""
    script, about, mesh, picture, light = (folder / name for name in FILES)
    write_png(picture, as_srgb(explanation.picture))
    write_object(mesh, explanation, bake(explanation))
    camera, latents = explanation.camera, explanation.latents
    write_json(about, {"width": camera.width, "height": camera.height, "K": camera.K.tolist()})
    # `glb_from_object` turns the object, and so its light, by minus the azimuth.
    turned = rotate_z(latents.light[0], -float(latents.azimuth[0]))
    with atomic_write(light) as temporary, temporary.open("wb") as file:
        np.save(file, panorama(np.asarray(turned)))
    write_bytes(script, (Path(__file__).parents[1] / "blender_scene.py").read_bytes())


def panorama(light: np.ndarray, rows: int = 32) -> np.ndarray:
    """Return the radiance of SH coefficients (9,) in all directions as Blender has it: (R, 2 R, 4) RGBA.

    Rows go up, columns clockwise with +X in the middle. Where the coefficients are below 0 it is 0.
    """
    up = (np.arange(rows)[:, None] + 0.5) * math.pi / rows - math.pi / 2
    azimuth = math.pi - (np.arange(2 * rows) + 0.5) * math.pi / rows
    flat = np.cos(up)
    directions = np.stack(np.broadcast_arrays(flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(up)), -1)
    radiance = (sh_basis(directions) @ light).clip(0.0)
    return np.stack([radiance] * 3 + [np.ones_like(radiance)], -1).astype(np.float32)
