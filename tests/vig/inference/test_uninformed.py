"""Fits of classes for which no network was trained: a search all round, by the objective alone."""

import math
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import vig
from tests.toys import toy
from vig.io.errors import UserError
from vig.recognition import WEIGHTS_FILE, Recognizer, UninformedRecognizer
from vig.record import camera_from_mesh
from vig.renderer import render_latents
from vig.scene import EXPOSURE_L00, Latents, ObjectClass, Symmetry
from vig.scene.object_class import PACKAGED

TURN, SCALE = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]), 0.001
FIN = toy("fin")
MOVED = np.eye(4)
MOVED[:3, :3], MOVED[:3, 3] = SCALE * TURN, (0.01, 0.02, 0.0)
RIGID = replace(
    FIN,
    shape_model=replace(
        FIN.shape_model,
        basis=np.zeros_like(FIN.shape_model.basis[:1]),
        explained_variance_ratio=np.zeros(1, np.float32),
    ),
    object_from_mesh=MOVED,
)
"""The same box as a class of one mesh, whose file is in millimetres and turned by a quarter."""


def photo_of(object_class: ObjectClass, azimuth_deg: float) -> tuple[np.ndarray, np.ndarray]:
    """A picture (150, 150, 3) of the mean shape on grey, and where it shows the object."""
    light = np.float32([[EXPOSURE_L00, 0.4, 0.9, 0.7, 0.0, 0.0, 0.0, 0.0, 0.0]])
    shape = np.zeros((1, object_class.shape_model.modes), np.float32)
    azimuth, elevation = np.float32([math.radians(azimuth_deg)]), np.float32([0.5])
    truth = Latents(shape, azimuth, elevation, np.float32([[0.6, 0.2, 0.1]]), light)
    image = render_latents(truth, object_class, object_class.camera())
    coverage = image.coverage[0].numpy()
    return image.rgb[0].numpy() + np.float32(0.35) * (1 - coverage[..., None]), coverage > 0.5


def off(found_deg: float, azimuth_deg: float) -> float:
    return abs((found_deg - azimuth_deg + 180) % 360 - 180)


@pytest.mark.parametrize("object_class", [FIN, RIGID], ids=["class", "one mesh"])
def test_views_are_found_all_round_from_a_mask(object_class: ObjectClass) -> None:
    explainer = vig.Explainer(object_class)
    assert not explainer.recognizer.informed
    for azimuth in (40.0, 200.0):
        photo, mask = photo_of(object_class, azimuth)
        found = explainer.explain(photo, focal=object_class.camera().focal, hints=vig.Hints(mask=mask))
        assert off(found.azimuth_deg, azimuth) < 5
        assert (found.amodal & mask).sum() / (found.amodal | mask).sum() > 0.95
        assert found.verdict is vig.Verdict.AMBIGUOUS and "no network" in found.reason
        assert math.isnan(found.confidence) and not found.trusted
        described = found.to_dict()["alternatives"]
        behind = [view["behind_nats"] for view in described]
        assert described and behind == sorted(behind) and behind[0] >= 0
        views = [found.azimuth_deg, *(view["azimuth_deg"] for view in described)]
        assert all(off(a, b) > 25 for i, a in enumerate(views) for b in views[:i])


def test_the_shape_of_one_mesh_is_held_and_its_pose_is_in_its_files_frame() -> None:
    photo, mask = photo_of(RIGID, 130.0)
    found = vig.Explainer(RIGID).explain(photo, hints=vig.Hints(mask=mask))
    assert not found.fit.latents.shape.any()
    K, pose, covariance = found.pinhole_pose()
    assert (np.linalg.eigvalsh(covariance) > 0).all()
    of_mesh = np.array(found.to_dict()["pinhole"]["camera_from_mesh"])
    assert found.to_dict()["pinhole"]["mesh_up"] == "+z" and found.to_dict()["pinhole"]["mesh_up_known"]
    np.testing.assert_allclose(of_mesh[:3, :3] @ of_mesh[:3, :3].T, np.eye(3), atol=1e-6)
    in_file = np.array([[100.0, 20.0, 30.0], [0.0, 0.0, 0.0]])  # millimetres
    in_class = in_file @ MOVED[:3, :3].T + MOVED[:3, 3]
    by_class = (in_class @ pose[:3, :3].T + pose[:3, 3]) @ K.T
    by_file = (in_file @ of_mesh[:3, :3].T + of_mesh[:3, 3]) @ K.T
    np.testing.assert_allclose(by_file[:, :2] / by_file[:, 2:], by_class[:, :2] / by_class[:, 2:], atol=1e-6)
    assert not camera_from_mesh(pose, FIN)


def test_a_box_alone_holds_the_size_and_views_are_unsure() -> None:
    photo, mask = photo_of(RIGID, 40.0)
    rows, columns = np.nonzero(mask)
    box = (float(columns.min()), float(rows.min()), float(np.ptp(columns) + 1), float(np.ptp(rows) + 1))
    found = vig.Explainer(RIGID).explain(photo, box, focal=RIGID.camera().focal)
    assert found.box is not None and np.abs(np.array(found.box) - box).max() < 0.05 * max(box[2:])
    described = found.to_dict()
    assert described["deviation"]["azimuth_deg"] == pytest.approx(360 / math.sqrt(12), abs=0.1)
    assert 0.5 < described["deviation"]["elevation_deg"] < 180 / math.sqrt(12)
    told = vig.Explainer(RIGID).explain(photo, box, hints=vig.Hints(azimuth_deg=found.azimuth_deg))
    assert told.to_dict()["deviation"]["azimuth_deg"] < 60, "the user chose the view"


@pytest.mark.parametrize("known", [True, False])
def test_distances_are_known_where_the_size_is(known: bool) -> None:
    photo, mask = photo_of(RIGID, 130.0)
    explainer = vig.Explainer(replace(RIGID, size_known=known))
    found = explainer.explain(photo, focal=300.0, hints=vig.Hints(mask=mask))
    assert found.distance_known is known and found.to_dict()["pinhole"]["distance_known"] is known
    _, pose, covariance = found.pinhole_pose()
    away = pose[:3, 3] / np.linalg.norm(pose[:3, 3])
    deviation = math.sqrt(away @ covariance[:3, :3] @ away) / np.linalg.norm(pose[:3, 3])
    assert (deviation > 0.9) is not known


def test_what_is_not_told_where_it_is_is_refused() -> None:
    photo, _ = photo_of(FIN, 10.0)
    with pytest.raises(UserError, match="expected a box or a mask"):
        vig.Explainer(FIN).explain(photo)
    with pytest.raises(UserError, match="expected a box or a mask"):
        vig.explain_found(photo, [vig.Explainer(FIN)], 2)


def test_every_class_is_predicted_alike_whatever_its_symmetry() -> None:
    photos = np.zeros((2, 150, 150, 3), np.float32)
    for symmetry, bins in ((Symmetry.NONE, 72), (Symmetry.HALF_TURN, 36), (Symmetry.ANY_TURN, 1)):
        prediction = UninformedRecognizer(replace(FIN, symmetry=symmetry))(photos)
        assert prediction.azimuth.shape == (2, bins)
        np.testing.assert_allclose(prediction.azimuth.sum(1), 1, rtol=1e-5)
        np.testing.assert_allclose(prediction.mask.sum(-1), 1, rtol=1e-5)


def test_a_pack_that_lost_its_weights_is_refused(tmp_path: Path) -> None:
    pack = tmp_path / "mug"
    shutil.copytree(PACKAGED / "mug", pack, ignore=shutil.ignore_patterns(WEIGHTS_FILE, "designs*"))
    with pytest.raises(UserError, match="recognition"):
        vig.Explainer(pack)
    (pack / "calibration.json").unlink()
    assert isinstance(vig.Explainer(pack).recognizer, UninformedRecognizer)
    assert type(vig.Explainer("mug").recognizer) is Recognizer
