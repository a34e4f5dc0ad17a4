"""Figures 4 and 5, and the pictures in them."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from vig.scene import EXPOSURE_L00, Latents, ObjectClass, rotate_z
from vig_paper.figures import photos
from vig_paper.figures.drawing import choose
from vig_paper.figures.photos import figure4, figure5
from vig_world.assets.panoramas.light import grey, project_panorama
from vig_world.dataset import Dataset
from vig_world.library import Library


def said(panels) -> list[str]:
    return [axes.get_xlabel() for axes in panels]


def pictures(panels) -> list[np.ndarray]:
    return [np.asarray(axes.get_images()[0].get_array()) for axes in panels]


def test_a_row_has_photo_truth_every_method_and_masks(
    caught, results, dataset: Dataset, teapot: ObjectClass, tmp_path: Path
) -> None:
    figures = caught(photos)
    figure4(dataset, teapot, results, [2, 0], tmp_path / "f.png")
    panels = figures[0].axes
    assert [axes.get_title() for axes in panels[:8]] == [
        *("photo", "truth", "recognition model", "Gaussian fit", "robust fit", "spatial fit"),
        *("spatial fit: mask", "truth: mask"),
    ]
    assert len(panels) == 16
    assert said(panels)[0].startswith(f"2: {dataset.occlusion[2]:.0%}")
    error, verdict = results["robust"].errors["azimuth_deg"][2], results["robust"].verdicts[2]
    assert said(panels)[4] == f"{error:.1f}° off, {verdict}"
    assert said(panels)[8].startswith("0: ")
    photo, *_, mask = pictures(panels[:8])
    np.testing.assert_allclose(photo, dataset.images[2] / 255)
    changed = np.abs(mask - photos._fade(photo)).max(-1) > 1e-6
    assert (changed == dataset.amodal[2]).mean() > 0.999


def test_methods_that_are_not_there_have_no_column(
    caught, results, dataset: Dataset, teapot: ObjectClass, tmp_path: Path
) -> None:
    figures = caught(photos)
    few = {name: results[name] for name in ("baseline", "rm")}
    figure4(dataset, teapot, few, choose(few, dataset, "rm")[:1], tmp_path / "f.png")
    assert len(figures[0].axes) == 5 and figures[0].axes[3].get_title() == "recognition model: mask"
    with pytest.raises(ValueError, match="at least one image"):
        figure4(dataset, teapot, few, [], tmp_path / "f.png")


def test_the_environment_map_is_turned_as_the_light_is(dataset: Dataset) -> None:
    """As a panorama of the camera's own frame it has the coefficients that the scene's light has there."""
    spec, azimuth = dataset.specs()[0], float(dataset.latents[0, 10])
    library = Library(spec.split)
    seen = photos.environment(library, spec, azimuth)
    # Columns fall from pi + 90 degrees; a panorama's rise from 0.
    panorama = np.roll(seen[:, ::-1], -len(seen) // 2, axis=1)
    found = grey(project_panorama(panorama))
    world = rotate_z(grey(project_panorama(library.radiance(spec.panorama))), spec.panorama_angle)
    expected = rotate_z(world, -azimuth)
    # Nearest pixels of 64 rows: an error of up to a pixel's 3 degrees.
    np.testing.assert_allclose(found, expected, atol=0.06 * EXPOSURE_L00)


def looking(azimuth: float, light: np.ndarray) -> Latents:
    """Level, from an azimuth, at something under a light (1, 9)."""
    return Latents(np.zeros((1, 10)), np.array([azimuth]), np.zeros(1), np.ones((1, 3)), light)


def test_light_from_the_cameras_left_is_on_the_left() -> None:
    # The camera on -Y (azimuth 0) has -X on its left; the coefficient of x is the fourth.
    light = np.zeros((1, 9))
    light[0, 0], light[0, 3] = 2.0, -1.0
    for azimuth in (0.0, 1.0):
        turned = rotate_z(light, azimuth)
        seen = photos.light_map(turned[0], azimuth)
        assert seen[32, 32] == pytest.approx(seen.max(), rel=1e-2)  # a quarter from the left edge
        assert (seen[:, :64] > seen[:, :63:-1]).all()
        latents = Latents(np.zeros((1, 10)), np.array([azimuth]), np.zeros(1), np.ones((1, 3)), turned)
        sphere = photos.white_sphere(latents)[..., 0]
        assert sphere[80, 10] > sphere[80, 80] > sphere[80, 149]
        assert sphere[0, 0] == 1  # around it is white


def test_light_from_above_is_up() -> None:
    light = np.zeros((1, 9))
    light[0, 0], light[0, 2] = 2.0, 1.0
    seen = photos.light_map(light[0], 0.3)
    assert (np.diff(seen, axis=0) < 0).all() and np.ptp(seen, axis=1).max() < 1e-6
    sphere = photos.white_sphere(looking(0.3, light))
    assert sphere[10, 80, 0] > sphere[149, 80, 0]


def test_lights_are_drawn_beside_the_environment_map(
    caught, results, dataset: Dataset, tmp_path: Path
) -> None:
    figures = caught(photos)
    figure5(dataset, results, [1], tmp_path / "f.png")
    panels = figures[0].axes
    assert len(panels) == 6 and panels[1].get_title() == "environment map"
    error = results["spatial"].errors["illumination"][1]
    assert said(panels)[3] == f"spatial fit; error {error:.3f}"
    with pytest.raises(ValueError, match="recognition model or a fit"):
        figure5(dataset, {"baseline": results["baseline"]}, [1], tmp_path / "f.png")


def test_a_users_own_panoramas_are_left_out(
    caught, results, made: Path, dataset: Dataset, tmp_path: Path
) -> None:
    root = tmp_path / "own"
    shutil.copytree(made, root)
    info = json.loads((root / "info.json").read_text())
    info["splits"]["test"]["own_assets"] = {"panorama/hall.hdr": "00"}
    (root / "info.json").write_text(json.dumps(info))
    figures = caught(photos)
    figure5(replace(dataset, folder=root / "test"), results, [1], tmp_path / "f.png")
    assert [axes.get_title() for axes in figures[0].axes[:2]] == ["photo", "true light"]
    assert len(figures[0].axes) == 5
