"""Figure 4: photos, their explanations and visible masks. Figure 5: true and fitted light."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from vig.inference import ExplainSettings
from vig.scene import Latents, ObjectClass, camera_rotation, irradiance, sh_basis, srgb_from_linear
from vig_paper.figures.style import (
    EXPLAINING_METHODS,
    NAMES,
    last_fit,
    outline,
    picture_grid,
    render_explanations,
    save,
    show_picture,
)
from vig_train.evaluation.results import MethodResult
from vig_world.dataset import Dataset
from vig_world.dataset.format import read_info
from vig_world.dataset.spec import SceneSpec
from vig_world.library import Library

MAP_ROWS = 64  # rows of a map of light in figure 5; it has twice as many columns


def figure4(
    dataset: Dataset,
    object_class: ObjectClass,
    results: Mapping[str, MethodResult],
    indices: Sequence[int],
    path: str | Path,
) -> Path:
    """Write a row for each image: photo, outline, renderings of the recognition model and the fits, masks.

    The outline is the true one of the whole object, hidden parts included. Renderings are drawn over the
    faded photo, with azimuth error and verdict below. In masks green is visible and pink hidden: those of the
    last fit (the recognition model's where there is none), and the true ones.
    """
    if not len(indices):
        raise ValueError("expected at least one image to show; got none")
    chosen = list(indices)
    truth = Latents.from_vector(dataset.latents[chosen])
    photos, amodal, visible = (dataset.read(name, chosen) for name in ("rgb", "mask", "mask_visib"))
    methods = [method for method in EXPLAINING_METHODS if method in results]
    titles = ["photo", "truth", *(NAMES[method] for method in methods)]
    titles += [f"{NAMES[methods[-1]]}: mask"] if methods else []
    figure, panels = picture_grid([*titles, "truth: mask"], len(chosen), 1.55)
    renderings = {}
    for method in methods:
        latents = results[method].latents
        assert latents is not None
        shadow = ExplainSettings().self_shadow
        renderings[method] = render_explanations(latents[np.array(chosen)], object_class, shadow)
    for row, index in enumerate(chosen):
        cells, photo = iter(panels[row]), photos[row] / 255.0
        show_picture(next(cells), photo, f"{index}: {dataset.occlusion[index]:.0%} hidden")
        axes = next(cells)
        show_picture(axes, photo, f"azimuth {np.degrees(truth.azimuth[row]) % 360:.0f}\N{DEGREE SIGN}")
        outline(axes, amodal[row])
        for method in methods:
            colours, coverage = (part[row] for part in renderings[method])
            axes, covered = next(cells), coverage[..., None]
            picture = _fade(photo) * (1 - covered) + srgb_from_linear(colours) * covered
            verdict, error = results[method].verdicts[index], results[method].errors["azimuth_deg"][index]
            caption = f"{error:.1f}\N{DEGREE SIGN} off"
            show_picture(axes, picture, f"{caption}, {verdict}" if verdict else caption)
            outline(axes, coverage >= 0.5)
        if methods:
            last, silhouette = results[methods[-1]], renderings[methods[-1]][1][row] >= 0.5
            mask = np.zeros_like(silhouette) if last.masks is None else last.masks[index]
            caption = f"IoU {last.errors['segmentation_iou'][index]:.2f}"
            show_picture(next(cells), _tint_masks(photo, silhouette, mask), caption)
        show_picture(next(cells), _tint_masks(photo, amodal[row], visible[row]))
    return save(figure, path)


def _fade(photo: np.ndarray) -> np.ndarray:
    """Return the photo behind a rendering or a mask: 45 % white is mixed in."""
    return 0.55 * photo + 0.45


def _tint_masks(photo: np.ndarray, amodal: np.ndarray, visible: np.ndarray) -> np.ndarray:
    """Return the photo faded, visible pixels green and the silhouette's others pink, half transparent."""
    picture = _fade(photo)
    for mask, colour in ((amodal & ~visible, (235, 40, 120)), (visible, (25, 179, 107))):
        picture[mask] = 0.4 * photo[mask] + 0.6 * np.array(colour) / 255
    return picture


def figure5(
    dataset: Dataset, results: Mapping[str, MethodResult], indices: Sequence[int], path: str | Path
) -> Path:
    """Write a row for each image: photo, environment map, true and fitted light as maps and on white spheres.

    The fitted light is the last fit's (the recognition model's where there is none). Everything is seen from
    the camera, the fitted light from the fitted camera: left is left in the photo, and the centre of a map is
    straight ahead. The environment map is left out where the panoramas were a user's own. The true light is
    the one that reaches the object: from below it is the support's, not the map's. One exposure for all;
    negative light is black.
    """
    if not len(indices):
        raise ValueError("expected at least one image to show; got none")
    method = last_fit(results)
    if method is None:
        raise ValueError("expected results of the recognition model or a fit; got neither")
    chosen, result = list(indices), results[method]
    assert result.latents is not None
    fitted = result.latents[np.array(chosen)]
    truth = Latents.from_vector(dataset.latents[chosen])
    settings = read_info(dataset.folder.parent)["splits"][dataset.folder.name]
    is_own = any(name.startswith("panorama/") for name in settings["own_assets"])
    specs = [] if is_own else dataset.specs()
    photos = dataset.read("rgb", chosen) / 255.0
    titles = ["photo", "environment map", "true light", "fitted light", "true, on white", "fitted, on white"]
    widths = [1.0, 2.0, 2.0, 2.0, 1.0, 1.0]
    if not specs:
        del titles[1], widths[1]
    figure, panels = picture_grid(titles, len(chosen), 1.3, widths)
    for row, index in enumerate(chosen):
        cells = iter(panels[row])
        show_picture(next(cells), photos[row], f"{index}: {dataset.occlusion[index]:.0%} hidden")
        if specs:
            surroundings = environment(Library(specs[0].split), specs[index], float(truth.azimuth[row]))
            show_picture(next(cells), _expose(surroundings), f"panorama {specs[index].panorama}")
        caption = f"{NAMES[method]}; error {result.errors['illumination'][index]:.3f}"
        for latents, text in ((truth, ""), (fitted, caption)):
            radiance = light_map(latents.light[row], float(latents.azimuth[row]))
            show_picture(next(cells), _expose(radiance), text)
        for latents in (truth, fitted):
            show_picture(next(cells), white_sphere(latents[row : row + 1]))
    return save(figure, path)


def environment(library: Library, spec: SceneSpec, azimuth: float) -> np.ndarray:
    """Return the panorama that lit a scene, as seen from a camera at `azimuth` radians.

    (MAP_ROWS, 2 MAP_ROWS, 3) linear radiance, straight up in the first row, straight ahead in the middle.
    """
    radiance = library.radiance(spec.panorama)
    height, width = radiance.shape[:2]
    angle = _headings(azimuth) - spec.panorama_angle
    columns = np.floor(angle / (2 * np.pi) * width).astype(int) % width
    rows = ((np.arange(MAP_ROWS) + 0.5) * height / MAP_ROWS).astype(int)
    return radiance[rows[:, None], columns]


def light_map(light: np.ndarray, azimuth: float) -> np.ndarray:
    """Return the radiance (MAP_ROWS, 2 MAP_ROWS) of a light (9,), in the view of `environment`; 0 or more."""
    theta = ((np.arange(MAP_ROWS) + 0.5) * np.pi / MAP_ROWS)[:, None]
    phi = _headings(azimuth)
    directions = np.stack(
        np.broadcast_arrays(np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)), axis=-1
    )
    return np.maximum(sh_basis(directions) @ light.astype(np.float64), 0.0)


def _headings(azimuth: float) -> np.ndarray:
    """Return world angle about +Z, from +X, of each column of a map: ahead in the centre, less to the right.

    A camera at azimuth 0 is on -Y and looks along +Y, which is 90 degrees from +X.
    """
    across = (np.arange(2 * MAP_ROWS) + 0.5) / (2 * MAP_ROWS)
    return azimuth + np.pi / 2 + np.pi - 2 * np.pi * across


def white_sphere(latents: Latents) -> np.ndarray:
    """Return a white sphere under one explanation's light and camera: (160, 160, 3) sRGB."""
    across = (np.arange(160) + 0.5) / 80 - 1
    x, y = np.meshgrid(across, across)
    inside = x**2 + y**2 < 1
    facing = -np.sqrt(np.clip(1 - x**2 - y**2, 0, None))  # towards the camera, which looks along +z
    rotation = camera_rotation(latents.azimuth, latents.elevation)[0].astype(np.float64)
    normals = np.stack([x, y, facing], axis=-1) @ rotation
    reflected = irradiance(latents.light[0].astype(np.float64), normals)
    return np.where(inside[..., None], _expose(reflected), 1.0)


def _expose(radiance: np.ndarray) -> np.ndarray:
    """Return radiance or irradiance, grey (H, W) or (H, W, 3), as sRGB (H, W, 3) at one exposure for all."""
    colours = radiance if radiance.ndim == 3 else np.repeat(radiance[..., None], 3, axis=-1)
    return srgb_from_linear(0.4 * colours)
