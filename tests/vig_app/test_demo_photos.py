"""The photos of the demo: complete, in range, and true to themselves."""

from __future__ import annotations

import math

import numpy as np
import pytest
from PIL import Image

from examples.make_demo import SHOTS, scene
from vig_app.demo import FOLDER, DemoPhoto, demo_photos
from vig_world.library import Library
from vig_world.raster.rasterize import rasterize
from vig_world.raster.view import View

PHOTOS, LIBRARY = demo_photos(), Library("test")
each = pytest.mark.parametrize("photo", PHOTOS, ids=[photo.name for photo in PHOTOS])


def mask(path) -> np.ndarray:
    with Image.open(path) as image:
        values = np.asarray(image)
    assert set(np.unique(values)) <= {0, 255}
    return values > 127


def test_there_are_teapots_and_mugs_one_of_them_asked_for_in_vain() -> None:
    assert len(PHOTOS) == 8
    assert {photo.shows for photo in PHOTOS} == {"teapot", "mug"}
    assert [photo.name for photo in PHOTOS if not photo.present] == [PHOTOS[-1].name]
    assert PHOTOS[0].occlusion < 0.02 and max(photo.occlusion for photo in PHOTOS) > 0.3
    assert len({photo.title for photo in PHOTOS}) == 8


def test_their_files_are_those_named_and_small() -> None:
    files = {path.relative_to(FOLDER).as_posix(): path for path in FOLDER.rglob("*") if path.is_file()}
    files = {name: path for name, path in files.items() if "__pycache__" not in name}
    named = {f"{photo.name}.jpg" for photo in PHOTOS}
    named |= {f"masks/{photo.name}_{kind}.png" for photo in PHOTOS for kind in ("visible", "amodal")}
    assert set(files) == named | {"__init__.py", "README.md", "truth.json", "shapes.safetensors"}
    assert sum(path.stat().st_size for path in files.values()) < 1.5e6


@each
def test_photo_is_large_and_well_exposed(photo: DemoPhoto) -> None:
    with Image.open(photo.photo) as image:
        assert (image.mode, image.size, image.format) == ("RGB", (800, 800), "JPEG")
        pixels = np.asarray(image)[mask(photo.visible_mask)] / 255
    assert 0.1 < pixels.mean() < 0.9
    assert (pixels.min(axis=1) == 1).mean() < 0.05


@each
def test_masks_agree_with_each_other_and_the_share_hidden(photo: DemoPhoto) -> None:
    visible, amodal = mask(photo.visible_mask), mask(photo.amodal_mask)
    assert visible.shape == amodal.shape == (800, 800)
    assert not (visible & ~amodal).any()
    assert photo.occlusion == pytest.approx(1 - visible.sum() / amodal.sum(), abs=1e-9)
    assert 0.08 < amodal.mean() < 0.6
    assert not (amodal[[0, -1]].any() or amodal[:, [0, -1]].any()), "the object lies whole within the frame"


@each
def test_truth_projects_onto_the_mask(photo: DemoPhoto) -> None:
    """The object's vertices, the packaged class's faces and the view give the silhouette: they belong."""
    object_class, spec = scene(LIBRARY, next(shot for shot in SHOTS if shot.name == photo.name))
    view = View.of_scene(spec, object_class, 800)
    faces = object_class.shape_model.faces
    drawn = rasterize(photo.vertices, faces, view.rotation, view.translation, view.camera, cull=True)
    covered, amodal = np.isfinite(drawn.depth), mask(photo.amodal_mask)
    assert (covered & amodal).sum() / (covered | amodal).sum() > 0.99
    assert math.degrees(spec.azimuth) == pytest.approx(photo.azimuth_deg, abs=1e-9)
    assert math.degrees(spec.elevation) == pytest.approx(photo.elevation_deg, abs=1e-9)
