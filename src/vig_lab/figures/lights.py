"""Figure 5: the environment map that lit a photo, and the light that was fitted."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import torch

from vig.dataset import Dataset
from vig.dataset.format import read_info
from vig.dataset.spec import SceneSpec
from vig.scene import Latents, camera_rotation, irradiance, sh_basis, srgb_from_linear
from vig_lab.evaluation.results import MethodResult
from vig_lab.figures.style import NAMES, head, last_fit, new_figure, save, show
from vig_world.library import Library

if TYPE_CHECKING:
    pass

HEIGHT = 1.3
"""Of a row, inches."""
MAP_ROWS, SPHERE_ROWS = 64, 160
EXPOSURE = 0.4
"""Radiance and irradiance are multiplied by it before they are shown as sRGB."""


def figure5(
    dataset: Dataset, results: Mapping[str, MethodResult], indices: Sequence[int], path: str | Path
) -> Path:
    """Write a row for each image: photo, environment map, true and fitted light as maps and on white spheres.

    The light of the last fit there is (the recognition model's where there is none). Everything is seen from
    the camera, its own for what was fitted: left is left in the photo, the middle of a map straight ahead.
    The environment map is left out where the panoramas were a user's own. The true light is what falls on the
    object: from below it is the support's, not the map's. All at one exposure; negative light is black.
    """
    if not len(indices):
        raise ValueError("expected at least one image to show; got none")
    method = last_fit(results)
    if method is None:
        raise ValueError("expected results of the recognition model or a fit; got neither")
    chosen, result = list(indices), results[method]
    assert result.latents is not None
    fitted = result.latents[torch.tensor(chosen)]
    truth = Latents.from_vector(torch.from_numpy(dataset.latents[chosen]))
    specs = None if _own_panoramas(dataset) else dataset.specs()
    library = None if specs is None else Library(specs[0].split)
    photos = dataset.read("rgb", chosen) / 255.0
    titles = ["photo", "environment map", "true light", "fitted light", "true, on white", "fitted, on white"]
    widths = [1.0, 2.0, 2.0, 2.0, 1.0, 1.0]
    if library is None:
        del titles[1], widths[1]
    figure = new_figure(HEIGHT * sum(widths) + 0.8, (HEIGHT + 0.2) * len(chosen) + 0.3)
    panels = figure.subplots(len(chosen), len(titles), squeeze=False, width_ratios=widths)
    for row, index in enumerate(chosen):
        cells = iter(panels[row])
        show(next(cells), photos[row], f"{index}: {dataset.occlusion[index]:.0%} hidden")
        if library is not None and specs is not None:
            seen = environment(library, specs[index], float(truth.azimuth[row]))
            show(next(cells), _exposed(seen), f"panorama {specs[index].panorama}")
        said = f"{NAMES[method]}; error {result.errors['illumination'][index]:.3f}"
        for latents, words in ((truth, ""), (fitted, said)):
            radiance = light_map(latents.light[row], float(latents.azimuth[row]))
            show(next(cells), _exposed(_grey(radiance)), words)
        for latents in (truth, fitted):
            show(next(cells), white_sphere(latents[row : row + 1]))
    head(panels[0], titles)
    return save(figure, path)


def environment(library: Library, spec: SceneSpec, azimuth: float) -> np.ndarray:
    """The panorama that lit a scene, as a camera at `azimuth` radians has it round itself.

    (MAP_ROWS, 2 MAP_ROWS, 3) linear radiance, straight up in the first row, straight ahead in the middle.
    """
    radiance = library.radiance(spec.panorama)
    height, width = radiance.shape[:2]
    angle = _headings(azimuth) - spec.panorama_angle
    columns = np.floor(angle / (2 * np.pi) * width).astype(int) % width
    rows = ((np.arange(MAP_ROWS) + 0.5) * height / MAP_ROWS).astype(int)
    return radiance[rows[:, None], columns]


def light_map(light: torch.Tensor, azimuth: float) -> np.ndarray:
    """Radiance (MAP_ROWS, 2 MAP_ROWS) of a light (9,), in the same view as `environment`; at least 0."""
    theta = ((np.arange(MAP_ROWS) + 0.5) * np.pi / MAP_ROWS)[:, None]
    phi = _headings(azimuth)
    directions = np.stack(
        np.broadcast_arrays(np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)), axis=-1
    )
    basis = sh_basis(torch.from_numpy(directions))
    return (basis @ light.double()).clamp_min(0.0).numpy()


def _headings(azimuth: float) -> np.ndarray:
    """World angle about +Z, from +X, of each column of a map: ahead in the middle, falling to the right.

    An eye at azimuth 0 is on -Y and looks along +Y, which is 90 degrees from +X.
    """
    across = (np.arange(2 * MAP_ROWS) + 0.5) / (2 * MAP_ROWS)
    return azimuth + np.pi / 2 + np.pi - 2 * np.pi * across


def white_sphere(latents: Latents) -> np.ndarray:
    """A white sphere under one explanation's light, from its camera: (SPHERE_ROWS, SPHERE_ROWS, 3) sRGB."""
    across = (np.arange(SPHERE_ROWS) + 0.5) * 2 / SPHERE_ROWS - 1
    x, y = np.meshgrid(across, across)
    inside = x**2 + y**2 < 1
    facing = -np.sqrt(np.clip(1 - x**2 - y**2, 0, None))  # towards the camera, which looks along +z
    rotation = camera_rotation(latents.azimuth, latents.elevation)[0].double().numpy()
    normals = np.stack([x, y, facing], axis=-1) @ rotation
    reflected = irradiance(latents.light[0].double(), torch.from_numpy(normals)).numpy()
    return np.where(inside[..., None], _exposed(_grey(reflected)), 1.0)


def _own_panoramas(dataset: Dataset) -> bool:
    """Whether a split was made with a user's own panoramas, which are not ours to draw."""
    settings = read_info(dataset.folder.parent)["splits"][dataset.folder.name]
    return any(name.startswith("panorama/") for name in settings["own_assets"])


def _grey(values: np.ndarray) -> np.ndarray:
    return np.repeat(values[..., None], 3, axis=-1)


def _exposed(radiance: np.ndarray) -> np.ndarray:
    return srgb_from_linear(EXPOSURE * radiance)
