"""A class that is no teapot, from its pack to an explanation, at a tiny scale."""

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest

from tests.support import SMALL
from tests.toys import toy
from vig import Explainer, Explanation
from vig.inference import ExplainSettings, Verdict
from vig.inference.calibration import FILE
from vig.inference.settings import Stage
from vig.io.errors import UserError
from vig.recognition import Recognizer
from vig.scene import ObjectClass, Symmetry
from vig_train.calibration.samples import calibrate_fits
from vig_train.evaluation.fits import FitRun
from vig_train.evaluation.protocol import evaluate
from vig_train.training import TrainingSettings, calibrate_network, train
from vig_world.assets.models import packaged_props
from vig_world.assets.things import is_of_class
from vig_world.dataset import Dataset, read_dataset
from vig_world.generation.write import make_dataset
from vig_world.studio.studio import WHOLE, Studio, StudioSettings

COUNT = 12
QUICK = ExplainSettings(stages=(Stage(4, 3),))
CLASSES = {
    "fin": {"size": 0.9, "places": {"floor": 1.0}, "front": "the fin"},
    "fins": {"size": 0.25, "symmetry": Symmetry.HALF_TURN, "mirror": False},
    "post": {"size": 0.12, "symmetry": Symmetry.ANY_TURN},
}


@pytest.fixture(scope="module", params=CLASSES)
def pack(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A class pack whose network was trained and calibrated on a few photos, which lie in it as `photos`."""
    folder = tmp_path_factory.mktemp(request.param)
    toy(request.param, **CLASSES[request.param]).save(folder)
    one = ObjectClass.load(folder)
    make_dataset(folder / "photos", COUNT, 3, workers=1, progress=False, object_class=one)
    photos = read_dataset(folder / "photos", "train")
    settings = TrainingSettings(
        epochs=2, batch=4, threads=1, network=SMALL, symmetry=one.symmetry, mirror=one.mirror
    )
    weights = train([photos], folder, settings, lambda line: None)
    calibrate_network(weights, [photos] * 5, object_class=one)
    recognizer = Recognizer.of_class(one)
    calibration, _ = calibrate_fits([photos], recognizer, FitRun(one, 1), QUICK)
    calibration.save(folder / FILE)
    return folder


@pytest.fixture(scope="module")
def photos(pack: Path) -> Dataset:
    return read_dataset(pack / "photos", "train")


def test_a_photo_is_explained_as_the_class(pack: Path, photos: Dataset) -> None:
    explainer = Explainer(pack, QUICK)
    one = explainer.object_class
    said: list[Explanation] = [explainer.explain(image, box=(30, 30, 90, 90)) for image in photos.images[:4]]
    for explanation in said:
        assert isinstance(explanation, Explanation) and not np.isnan(explanation.confidence)
        described = explanation.to_dict()
        assert described["class"] == one.name and described["front"] == one.front
        least = {"none": 360, "half-turn": 180, "any-turn": 1e-9}[one.symmetry]
        assert 0 <= described["azimuth_deg"] < least
        if one.symmetry is Symmetry.ANY_TURN:
            assert described["deviation"]["azimuth_deg"] is None and not explanation.alternatives
        near = one.viewing_distance * explanation.camera_distance_ratio * 150 / explanation.window.side
        assert 0.3 < explanation.camera.distance / near < 3, "metres are those of the class's size"


def test_without_calibration_the_symmetry_makes_nothing_ambiguous(pack: Path, photos: Dataset) -> None:
    explainer = Explainer(pack, dataclasses.replace(QUICK, calibrated=False))
    symmetry = explainer.object_class.symmetry
    for image in photos.images[:4]:
        explanation = explainer.explain(image, box=(30, 30, 90, 90))
        if symmetry is Symmetry.ANY_TURN:
            assert explanation.verdict is not Verdict.AMBIGUOUS
        for other in explanation.alternatives:
            turned = symmetry.difference(other.latents.azimuth, explanation.latents.azimuth)
            assert abs(turned.item()) > 0.3


def test_errors_are_between_views_that_look_the_same(pack: Path, photos: Dataset) -> None:
    one = ObjectClass.load(pack)
    methods = ("baseline", "rm", "spatial")
    results = evaluate(photos, Recognizer.of_class(one), FitRun(one, 1), methods, QUICK)
    most = {"none": 180, "half-turn": 90, "any-turn": 0}[one.symmetry]
    for result in results.values():
        if "azimuth_deg" in result.errors:
            assert result.errors["azimuth_deg"].max() <= most + 1e-3


def test_things_stand_where_the_class_says(pack: Path, photos: Dataset) -> None:
    zones = {spec.room.zone for spec in photos.specs()}
    assert len(zones) > 1 if ObjectClass.load(pack).name != "fin" else zones <= {"floor", "display"}


def test_a_dataset_states_the_symmetry_as_bop_does(pack: Path) -> None:
    one = ObjectClass.load(pack)
    found = json.loads((pack / "photos" / "models" / "models_info.json").read_text())["1"]
    named = {"none": None, "half-turn": "symmetries_discrete", "any-turn": "symmetries_continuous"}[
        one.symmetry
    ]
    assert [name for name in found if name.startswith("symmetries")] == ([named] if named else [])
    if named == "symmetries_discrete":
        turn = np.array(found[named][0]).reshape(4, 4)[:3, :3]
        turned = one.shape_model.mean @ turn.T
        off = np.abs(turned[:, None] - one.shape_model.mean[None]).max(2).min(1)
        assert off.max() < 1e-6, "every vertex comes to lie where one was"


def test_a_studio_draws_a_class_of_one_part(pack: Path) -> None:
    studio = Studio(ObjectClass.load(pack), StudioSettings(absent=0.5))
    shown = [studio.draw(0, index).visible.any() for index in range(12)]
    assert WHOLE == 4 and 2 <= sum(shown) <= 10


def test_zones_that_no_room_has_are_refused_in_one_line(tmp_path: Path) -> None:
    one = toy("fin", places={"moon": 1.0})
    with pytest.raises(UserError, match="places of class 'fin' among cooking, .*; got 'moon'. Correct"):
        make_dataset(tmp_path, 1, 0, workers=1, progress=False, object_class=one)
    assert not any(tmp_path.iterdir())


def test_props_that_are_named_like_a_class_are_left_out() -> None:
    families = packaged_props("train")
    assert {name for name in families if is_of_class(name, "Mug")} == {"cup", "cup_cake", "mug"}
    assert {"cup", "mug", "place_setting"} <= {name for name in families if is_of_class(name, "my_cups")}
    assert {name for name in families if is_of_class(name, "teapot")} == {"kettle", "teapot"}
