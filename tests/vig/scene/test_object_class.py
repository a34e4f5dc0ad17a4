from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from vig.errors import UserError
from vig.scene import EXPOSURE_L00, ObjectClass
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


def test_the_fingerprint_is_of_the_shapes_and_the_height(teapot: ObjectClass, tmp_path: Path) -> None:
    assert teapot.fingerprint == FINGERPRINT
    assert replace(teapot, name="other").fingerprint == teapot.fingerprint
    assert replace(teapot, target_height=0.2).fingerprint != teapot.fingerprint
    model = teapot.shape_model
    for changed in (
        replace(model, mean=model.mean + 1e-3),
        replace(model, basis=2 * model.basis),
        replace(model, faces=model.faces[::-1].copy()),
    ):
        assert replace(teapot, shape_model=changed).fingerprint != teapot.fingerprint


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


def drop_mean(folder: Path) -> None:
    description = json.loads((folder / "class.json").read_text())
    del description["light_prior"]["mean"]
    (folder / "class.json").write_text(json.dumps(description))


def no_object(folder: Path) -> None:
    (folder / "class.json").write_text("[1, 2]")


@pytest.mark.parametrize(
    "damage",
    [
        lambda folder: (folder / "class.json").write_text("{ half of"),
        lambda folder: (folder / "class.json").write_bytes(b"\xff\xfe\x00"),
        no_object,
        drop_mean,
        lambda folder: (folder / "shape.safetensors").unlink(),
        lambda folder: (folder / "shape.safetensors").write_bytes(b""),
        lambda folder: (folder / "shape.safetensors").write_bytes(
            (folder / "shape.safetensors").read_bytes()[:1000]
        ),
    ],
    ids=["half json", "not text", "not an object", "no mean", "no shape", "empty shape", "cut shape"],
)
def test_a_damaged_pack_is_told_in_one_line(
    teapot: ObjectClass, tmp_path: Path, damage: Callable[[Path], object]
) -> None:
    teapot.save(tmp_path)
    damage(tmp_path)
    with pytest.raises(UserError) as caught:
        ObjectClass.load(tmp_path)
    assert "\n" not in str(caught.value)
    assert str(tmp_path) in str(caught.value) and "Build or copy it again." in str(caught.value)


@pytest.mark.parametrize("name", ["kettle", "no/such/folder", ""])
def test_an_unknown_class_is_answered_with_those_there_are(name: str) -> None:
    with pytest.raises(UserError, match="one of .*teapot.*; got") as caught:
        ObjectClass.load(name)
    assert "\n" not in str(caught.value)
