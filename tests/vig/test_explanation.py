"""What is written for the user of one fit."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
import trimesh
from PIL import Image

from vig import Explanation
from vig.errors import UserError
from vig.inference import Fit, Verdict
from vig.inference.calibration import CONFIDENCE_FEATURES
from vig.photo.window import Window
from vig.report.files import write_glb
from vig.scene import Latents, ObjectClass


def latents() -> Latents:
    light = torch.tensor([[2.356, *[0.1] * 8]])
    albedo = torch.tensor([[0.8, 0.4, 0.1]])
    return Latents(torch.full((1, 10), 0.5), torch.tensor([-1.0]), torch.tensor([0.5]), albedo, light)


def written(
    folder: Path, photo: np.ndarray, window: Window, fit: Fit, object_class: ObjectClass
) -> dict[str, Any]:
    """What the JSON of a saved explanation holds."""
    explanation = Explanation(photo, window, fit, object_class)
    assert explanation.save(folder) == folder
    return explanation.to_dict()


@pytest.fixture
def fit() -> Fit:
    """An object over rows 50-99, columns 50-99 of the window; its right half is hidden."""
    amodal = torch.zeros(150, 150, dtype=torch.bool)
    amodal[50:100, 50:100] = True
    mask = amodal.clone()
    mask[:, 75:] = False
    return Fit(
        latents=latents(),
        framing=torch.tensor([0.01, 0.02, 0.1, 0.03]),
        deviation=torch.arange(1, 25) / 100,
        visible=mask.float(),
        mask=mask,
        mask_by_pixel=mask,
        amodal=amodal,
        verdict=Verdict.TRUSTED,
        reason=Verdict.TRUSTED.value,
        confidence=0.9,
        confidence_features=torch.zeros(len(CONFIDENCE_FEATURES)),
        evidence=123.456789,
        start_evidence=-1.0,
        evaluations=77,
        alternative=None,
    )


def test_four_files_are_written_and_the_json_says_what_was_returned(
    fit: Fit, teapot: ObjectClass, tmp_path: Path
) -> None:
    photo = np.full((150, 150, 3), 0.2, np.float32)
    said = written(tmp_path / "new" / "photo", photo, Window.of(150, 150), fit, teapot)
    folder = tmp_path / "new" / "photo"
    assert {path.name for path in folder.iterdir()} == {
        "explanation.json",
        "overlay.png",
        "mask.png",
        "object.glb",
    }
    assert json.loads((folder / "explanation.json").read_text()) == said
    assert Image.open(folder / "overlay.png").size == (150, 150)


def test_the_json_speaks_degrees_and_names_every_latent(
    fit: Fit, teapot: ObjectClass, tmp_path: Path
) -> None:
    photo = np.full((150, 150, 3), 0.2, np.float32)
    said = written(tmp_path, photo, Window.of(150, 150), fit, teapot)
    assert set(said) == {
        *(
            "vig",
            "class",
            "verdict",
            "reason",
            "confidence",
            "azimuth_deg",
            "elevation_deg",
            "albedo",
            "light",
            "shape",
        ),
        *("alternative", "deviation", "hidden_fraction", "evidence_nats", "start_evidence_nats"),
        *("evaluations", "window", "framing", "camera", "roll_deg", "family", "box", "front"),
    }
    assert (said["class"], said["verdict"]) == ("teapot", "trusted")
    assert said["azimuth_deg"] == pytest.approx(360 - math.degrees(1), abs=1e-4)  # in [0, 360)
    assert said["elevation_deg"] == pytest.approx(math.degrees(0.5), abs=1e-4)
    assert said["albedo"] == pytest.approx([0.8, 0.4, 0.1])
    assert len(said["light"]) == 9 and said["light"][0] == pytest.approx(2.356)
    assert said["shape"] == [0.5] * 10
    deviation = said["deviation"]
    assert deviation["shape"] == pytest.approx([i / 100 for i in range(1, 11)])
    assert deviation["azimuth_deg"] == pytest.approx(math.degrees(0.11), abs=1e-4)
    assert deviation["elevation_deg"] == pytest.approx(math.degrees(0.12), abs=1e-4)
    assert deviation["albedo"] == pytest.approx([0.13, 0.14, 0.15])
    assert deviation["light"] == pytest.approx([i / 100 for i in range(16, 25)])
    assert said["hidden_fraction"] == 0.5
    assert said["window"] == {"left": 0, "top": 0, "side": 150}
    assert said["framing"]["magnification"] == pytest.approx(math.exp(0.1), abs=1e-4)
    assert said["alternative"] is None


def test_the_other_explanation_is_told(fit: Fit, teapot: ObjectClass, tmp_path: Path) -> None:
    other = replace(latents(), azimuth=torch.tensor([2.0]))
    ambiguous = replace(fit, verdict=Verdict.AMBIGUOUS, reason="two", alternative=other)
    photo = np.full((150, 150, 3), 0.2, np.float32)
    said = written(tmp_path, photo, Window.of(150, 150), ambiguous, teapot)
    assert said["verdict"] == "ambiguous" and said["reason"] == "two"
    assert said["alternative"]["azimuth_deg"] == pytest.approx(math.degrees(2.0), abs=1e-4)
    assert set(said["alternative"]) == {"azimuth_deg", "elevation_deg", "albedo", "light", "shape"}


def test_the_mask_has_three_values_in_the_photos_own_frame(
    fit: Fit, teapot: ObjectClass, tmp_path: Path
) -> None:
    """A window of side 300 at (-30, 40) in a photo of 400 x 320: every window pixel is two of the photo's."""
    written(tmp_path, np.full((320, 400, 3), 0.2, np.float32), Window(-30, 40, 300), fit, teapot)
    mask = np.asarray(Image.open(tmp_path / "mask.png"))
    expected = np.zeros((320, 400), np.uint8)
    expected[140:240, 70:120] = 255
    expected[140:240, 120:170] = 128
    assert mask.shape == expected.shape and set(np.unique(mask)) == {0, 128, 255}
    assert (mask != expected).mean() < 0.002  # half a pixel along the edges at most


def test_what_lies_beyond_the_photo_is_not_called_hidden(
    fit: Fit, teapot: ObjectClass, tmp_path: Path
) -> None:
    """The photo ends where the hidden half begins: all of the object that it shows is visible."""
    said = written(tmp_path, np.full((150, 75, 3), 0.2, np.float32), Window(0, 0, 150), fit, teapot)
    assert said["hidden_fraction"] == 0.0


def test_nothing_covered_is_not_a_fraction(fit: Fit, teapot: ObjectClass, tmp_path: Path) -> None:
    nothing = torch.zeros(150, 150, dtype=torch.bool)
    empty = replace(fit, amodal=nothing, mask=nothing)
    said = written(tmp_path, np.full((150, 150, 3), 0.2, np.float32), Window.of(150, 150), empty, teapot)
    assert said["hidden_fraction"] is None
    assert not np.asarray(Image.open(tmp_path / "mask.png")).any()


def test_the_object_is_in_metres_with_y_up_and_its_albedo(teapot: ObjectClass, tmp_path: Path) -> None:
    write_glb(tmp_path / "object.glb", latents(), teapot)
    scene = trimesh.load(tmp_path / "object.glb")
    (mesh,) = scene.geometry.values()
    z_up = teapot.shape_model.vertices(latents().shape)[0].numpy()
    x, y, z = np.ptp(z_up, axis=0)
    np.testing.assert_allclose(scene.extents, (x, z, y), rtol=1e-5)
    assert 0.2 < scene.extents[0] < 0.4  # metres
    assert scene.bounds[0][1] == pytest.approx(z_up[:, 2].min(), abs=1e-6)  # it stands on y = 0
    assert len(mesh.faces) == len(teapot.shape_model.faces)
    assert mesh.volume > 0  # outward faces: turned, not mirrored
    # Spout towards +x: the mesh's farthest point in x is the class's.
    tip = z_up[z_up[:, 0].argmax()]
    np.testing.assert_allclose(
        mesh.vertices[mesh.vertices[:, 0].argmax()], (tip[0], tip[2], -tip[1]), atol=1e-4
    )
    colour = np.asarray(mesh.visual.material.baseColorFactor) / 255
    np.testing.assert_allclose(colour, [0.8, 0.4, 0.1, 1.0], atol=1 / 255)
    assert mesh.visual.material.metallicFactor == 0 and mesh.visual.material.roughnessFactor == 1


def test_a_file_where_the_folder_should_be_is_told(fit: Fit, teapot: ObjectClass, tmp_path: Path) -> None:
    (tmp_path / "taken").write_text("mine")
    photo = np.full((150, 150, 3), 0.2, np.float32)
    with pytest.raises(UserError, match="a part of the path is a file"):
        written(tmp_path / "taken", photo, Window.of(150, 150), fit, teapot)
    assert (tmp_path / "taken").read_text() == "mine"


def test_a_verdict_prints_as_the_json_has_it() -> None:
    assert [str(verdict) for verdict in Verdict] == ["trusted", "reverted", "ambiguous", "failed"]


def test_an_ambiguous_fit_has_its_other_explanation(fit: Fit, teapot: ObjectClass) -> None:
    photo, window = np.full((150, 150, 3), 0.2, np.float32), Window.of(150, 150)
    assert Explanation(photo, window, fit, teapot).alternatives == ()
    other = replace(latents(), azimuth=torch.tensor([2.0]))
    found = Explanation(photo, window, replace(fit, alternative=other), teapot)
    assert found.alternatives == (other,)
