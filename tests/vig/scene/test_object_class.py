import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.toys import toy
from vig import Explainer
from vig.io.errors import UserError
from vig.scene import EXPOSURE_L00, Camera, ObjectClass, Symmetry
from vig.scene.object_class import BUILD_COMMAND, PACKAGED, TRANSFER_FILE
from vig_world.mesh import face_normals

FINGERPRINT = "de30279b73603cfd"
"""Of the packaged teapot, as datasets of version 0.1 hold it."""


def test_a_saved_pack_is_read_back(teapot: ObjectClass, tmp_path: Path) -> None:
    teapot.save(tmp_path / "pack")
    again = ObjectClass.load(tmp_path / "pack")
    assert again.folder == tmp_path / "pack"
    assert (again.name, again.target_height) == (teapot.name, teapot.target_height)
    np.testing.assert_array_equal(again.light_prior_mean, teapot.light_prior_mean)
    np.testing.assert_array_equal(again.light_prior_covariance, teapot.light_prior_covariance)
    ours, theirs = vars(teapot.shape_model), vars(again.shape_model)
    assert ours.keys() == theirs.keys()
    for name, value in ours.items():
        np.testing.assert_array_equal(theirs[name], value)
        assert getattr(theirs[name], "dtype", None) == getattr(value, "dtype", None)


def test_the_fingerprint_is_of_shapes_and_views_and_not_of_names(teapot: ObjectClass) -> None:
    assert teapot.fingerprint == FINGERPRINT
    model = teapot.shape_model
    for same in ({"name": "other"}, {"front": "the spout", "points": {"tip": 1}}):
        assert replace(teapot, **same).fingerprint == FINGERPRINT
    for changed in (
        {"target_height": 0.2},
        {"symmetry": Symmetry.HALF_TURN},
        {"mirror": False},
        {"viewing_distance": 0.5},
        {"places": {"floor": 1.0}},
        {"shape_model": replace(model, mean=model.mean + 1e-3)},
        {"shape_model": replace(model, basis=2 * model.basis)},
        {"shape_model": replace(model, faces=model.faces[::-1].copy())},
    ):
        assert replace(teapot, **changed).fingerprint != FINGERPRINT


def test_saving_leaves_the_weights_that_lie_there(teapot: ObjectClass, tmp_path: Path) -> None:
    (tmp_path / "recognition.safetensors").write_bytes(b"kept")
    teapot.save(tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "class.json",
        "recognition.safetensors",
        "shape.safetensors",
    ]
    assert (tmp_path / "recognition.safetensors").read_bytes() == b"kept"


def test_the_packaged_teapot_is_a_teapot(teapot: ObjectClass) -> None:
    model = teapot.shape_model
    assert model.modes == 10 and len(model.parts) == len(model.mean)
    assert {"body", "lid", "knob", "foot", "spout", "handle"} == set(model.part_names)
    assert np.ptp(model.mean[:, 0]) == pytest.approx(0.28, abs=0.03)
    assert model.mean[:, 2].min() == pytest.approx(0, abs=1e-3)
    spout, handle = (model.mean[model.parts == model.part_names.index(p)] for p in ("spout", "handle"))
    assert spout[:, 0].max() == pytest.approx(model.mean[:, 0].max())  # +X
    assert handle[:, 0].min() == pytest.approx(model.mean[:, 0].min())  # -X
    # Outward faces: the signed volume (divergence theorem) is positive.
    centres = model.mean[model.faces].mean(1)
    assert (centres * face_normals(model.mean, model.faces)).sum() > 0


def test_the_packaged_light_prior_is_a_gaussian_at_the_papers_exposure(teapot: ObjectClass) -> None:
    covariance = teapot.light_prior_covariance
    assert teapot.light_prior_mean[0] == pytest.approx(EXPOSURE_L00, abs=1e-5)
    np.testing.assert_allclose(covariance, covariance.T)
    assert np.linalg.eigvalsh(covariance).min() > 0


def test_what_a_class_says_of_its_views_is_saved_and_read(tmp_path: Path) -> None:
    given = toy(
        "fins",
        0.9,
        symmetry=Symmetry.HALF_TURN,
        mirror=False,
        front="a fin",
        points={"corner": 3},
        places={"floor": 1.0},
    )
    given.save(tmp_path)
    again = ObjectClass.load(tmp_path)
    for name in ("symmetry", "mirror", "front", "points", "viewing_distance", "places", "fingerprint"):
        assert getattr(again, name) == getattr(given, name), name
    assert isinstance(again.symmetry, Symmetry)


def test_a_pack_that_says_nothing_of_its_views_is_seen_as_a_teapot_is(teapot: ObjectClass) -> None:
    assert teapot.symmetry is Symmetry.NONE and teapot.mirror and teapot.viewing_distance == 0.4
    assert not teapot.points and not teapot.places and teapot.front == ""
    assert teapot.at_unit_scale is teapot and teapot.scale == 1
    assert teapot.camera(90, 2.0) == Camera.standard(90, teapot.target_height, 2.0)


def test_a_large_thing_looks_as_a_small_one_from_so_much_nearer() -> None:
    """Twice the size and the distance: every vertex is at the same pixel."""
    large, small = toy("fin", 0.9), toy("fin", 0.45)
    pixels = []
    for each in (large, small, large.at_unit_scale):
        matrix = each.camera().camera_from_world(0.7, 0.3)
        seen = (each.shape_model.mean @ matrix[:3, :3].T + matrix[:3, 3]) @ each.camera().K.T
        pixels.append(seen[:, :2] / seen[:, 2:])
    np.testing.assert_allclose(pixels[0], pixels[1], atol=1e-3)
    np.testing.assert_allclose(pixels[0], pixels[2], atol=1e-3)
    assert large.at_unit_scale.camera().distance == 0.4


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"symmetry": "third-turn"}, "Invalid enum value 'third-turn' - at `$.symmetry`"),
        ({"mirror": 1}, "Expected `bool`, got `int` - at `$.mirror`"),
        ({"front": "a\nb"}, "front must be 1 to 100 printable characters"),
        ({"points": {"tip": 10**6}}, "points must be from 0 to"),
        ({"points": {"tip": 1.5}}, "Expected `int`, got `float` - at `$.points[...]`"),
        ({"points": {"": 1}}, "name of a point must be 1 to 100 printable characters"),
        ({"viewing_distance_m": 0}, "viewing_distance must be a number from 0.01 to 100; it is 0"),
        ({"viewing_distance_m": "far"}, "Expected `float`, got `str` - at `$.viewing_distance_m`"),
        ({"places": {"floor": -1}}, "places 'floor' must be a number from 0 to"),
        ({"places": {"floor": 0}}, "places must have a frequency above 0"),
        ({"places": ["floor"]}, "Expected `object`, got `array` - at `$.places`"),
        ({"back": "no"}, "Object contains unknown field `back`"),
    ],
)
def test_a_wrong_field_is_told_in_one_line(changed: dict, said: str, tmp_path: Path) -> None:
    toy("fin").save(tmp_path)
    path = tmp_path / "class.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | changed))
    with pytest.raises(UserError) as caught:
        ObjectClass.load(tmp_path)
    assert "\n" not in str(caught.value) and said in str(caught.value)


def test_a_half_built_pack_says_which_command_to_run_again(tmp_path: Path) -> None:
    command = "vig class build 'my cups' --out cup --up z"
    (tmp_path / "build").mkdir()
    (tmp_path / BUILD_COMMAND).write_text(f"{command}\n")
    with pytest.raises(UserError) as caught:
        Explainer(tmp_path)
    expected = f"expected a class; the build of '{tmp_path}' is unfinished. Run it again: {command}"
    assert str(caught.value) == expected
    toy("fin").save(tmp_path)  # as where the build was killed while it trained the recognizer
    with pytest.raises(UserError, match="unfinished"):
        Explainer(tmp_path)
    assert ObjectClass.load(tmp_path, unfinished=True).name == "fin"


def test_a_pack_without_the_table_that_it_tells_of_is_refused(teapot: ObjectClass, tmp_path: Path) -> None:
    """It would answer otherwise in silence."""
    pack = tmp_path / "pack"
    shutil.copytree(PACKAGED / "teapot", pack)
    assert ObjectClass.load(pack).transfer is not None
    (pack / TRANSFER_FILE).unlink()
    with pytest.raises(UserError, match="expected transfer.safetensors, which class.json tells of"):
        ObjectClass.load(pack)
    ObjectClass.load("teapot").save(pack)  # what has no table does not tell of one
    assert ObjectClass.load(pack).transfer is None
