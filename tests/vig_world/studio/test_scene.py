"""Datasets of the studio: labels are those of an independent projection, bytes a pure function."""

from pathlib import Path

import numpy as np
import pytest

from tests.support import contents, differing
from vig.inference import ExplainSettings
from vig.inference.settings import PHOTO
from vig.io.errors import UserError
from vig.scene import ObjectClass
from vig_train.evaluation.fits import fit_settings
from vig_world.dataset import read_dataset
from vig_world.generation.check import check_dataset
from vig_world.generation.coco import export_coco_keypoints
from vig_world.generation.write import make_dataset
from vig_world.raster.rasterize import rasterize
from vig_world.raster.view import View
from vig_world.studio import Studio, StudioScenes, StudioSettings

SPLIT, SEED, COUNT = "validation", 7, 6


@pytest.fixture(scope="module")
def made(teapot: ObjectClass, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("studio") / "made"
    settings = {"split": SPLIT, "world": "studio", "progress": False}
    return make_dataset(out, COUNT, SEED, object_class=teapot, workers=1, **settings)


def test_images_are_those_of_the_studio_and_are_made_again_from_their_specs(
    made: Path, tmp_path: Path, teapot: ObjectClass
) -> None:
    findings = check_dataset(made, SPLIT, render=COUNT, object_class=teapot)
    assert findings.clean, findings.problems
    settings = {"split": SPLIT, "world": "studio", "progress": False}
    other = make_dataset(tmp_path / "two", COUNT, SEED, object_class=teapot, workers=2, **settings)
    assert not differing(contents(other), contents(made))
    studio, dataset = Studio(teapot, StudioSettings(absent=0.0), SPLIT), read_dataset(made, SPLIT)
    for index, image in enumerate(dataset.images):
        drawn = studio.draw(SEED, index)
        np.testing.assert_array_equal(image, drawn.image)
        np.testing.assert_allclose(dataset.latents[index], drawn.latents, rtol=1e-6)


def test_the_camera_projects_the_object_onto_its_mask(teapot: ObjectClass) -> None:
    scenes, studio = StudioScenes(teapot, SPLIT), Studio(teapot, StudioSettings(absent=0.0), SPLIT)
    occluded = 0
    for index in range(12):
        spec, drawn = scenes.sample(SEED, index), studio.draw(SEED, index)
        picture, view = scenes.render(spec), View.of_scene(spec, teapot)
        alone = rasterize(drawn.vertices, drawn.faces, view.rotation, view.translation, view.camera).depth
        union = picture.amodal | np.isfinite(alone)
        assert (picture.amodal & np.isfinite(alone)).sum() / union.sum() > 0.96
        assert not (picture.visible & ~picture.amodal).any()
        assert picture.occlusion == pytest.approx(spec.occlusion)
        seen = np.isfinite(picture.depth)
        assert (seen <= picture.visible).all() and seen.sum() > 0.9 * picture.visible.sum()
        distance = np.linalg.norm(view.eye)
        assert np.abs(picture.depth[seen] - distance).max() < distance
        occluded += picture.cause == "occluder"
    assert occluded > 3


def test_it_has_no_keypoints_and_is_fitted_as_photographs_are(
    made: Path, tmp_path: Path, teapot: ObjectClass
) -> None:
    with pytest.raises(UserError, match="of the studio, whose objects are warped.*export to coco"):
        export_coco_keypoints(made, tmp_path / "out", SPLIT, teapot)
    assert not (tmp_path / "out").exists()
    settings = fit_settings(ExplainSettings(), teapot, read_dataset(made, SPLIT))
    assert settings.free_framing and settings.stages == PHOTO["stages"]


@pytest.mark.parametrize(
    "settings", [{"tier": "cycles"}, {"size": (320, 240)}, {"normals": True}, {"photo": True}], ids=str
)
def test_what_the_studio_does_not_make_is_refused_before_anything_is_written(
    tmp_path: Path, settings: dict
) -> None:
    with pytest.raises(UserError, match="150x150 pixels.*got another [a-z]+. Leave it out"):
        make_dataset(tmp_path / "out", 2, 1, world="studio", **settings)
    assert not (tmp_path / "out").exists()
