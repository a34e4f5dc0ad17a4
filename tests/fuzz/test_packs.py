"""Damaged class packs, weights and calibrations: read to what can be drawn, or refused in a line."""

import json
import shutil
import struct
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from safetensors.numpy import load_file, save_file

from tests.fuzz.mutations import Damage, damaged_json, damaged_tensors, read_damaged
from tests.support import SMALL
from vig.inference.calibration import CONFIDENCE_FEATURES, FitCalibration, calibration_of
from vig.io.errors import UserError
from vig.likelihood.geometry import Geometry
from vig.recognition import Recognizer
from vig.recognition.weights import FORMAT
from vig.scene import Camera, ObjectClass, ShapeModel
from vig.scene.object_class import PACKAGED, TRANSFER_FILE
from vig_paper.network.network import PaperNetworks, PaperSettings
from vig_paper.network.recognizer import PaperRecognizer
from vig_train.network.network import RecognitionNetwork
from vig_train.training.checkpoint import save_weights
from vig_world.raster.rasterize import rasterize

CUBE = np.array([[x, y, z] for x in (0, 0.1) for y in (0, 0.1) for z in (0, 0.1)], np.float32)
CUBE_FACES = np.array(
    [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6], [0, 2, 6],
     [0, 6, 4], [1, 5, 7], [1, 7, 3]], np.int32,
)  # fmt: skip
CAMERA = Camera.standard(40)


@pytest.fixture
def pack(tmp_path: Path) -> Path:
    """A small class of boxes with every file that a class can have."""
    basis = np.stack([CUBE, -CUBE[::-1]]) * np.float32(0.1)
    ratio = np.array([0.7, 0.3], np.float32)
    model = ShapeModel(CUBE, basis, CUBE_FACES, np.zeros(8, np.int32), ("box",), ratio)
    mean = np.array([2.0, *[0.1] * 8])
    ObjectClass("box", model, 0.05, mean, np.eye(9)).save(tmp_path / "pack")
    save_file({"transfer": np.zeros((3, 8, 9), np.float16)}, tmp_path / "pack" / TRANSFER_FILE)
    calibration = FitCalibration.load(PACKAGED / "teapot" / "calibration.json")
    rows = np.ones((2, 16))
    replace(calibration, scale=rows, floor=rows).save(tmp_path / "pack" / "calibration.json")
    torch.manual_seed(0)
    small = replace(SMALL, modes=2, azimuth_bins=8)
    scale = {"mean": torch.zeros(15), "deviation": torch.ones(15)}
    save_weights(RecognitionNetwork(small), scale, tmp_path / "pack" / "recognition.safetensors")
    return tmp_path / "pack"


def drawn(folder: Path) -> None:
    """Read a class and draw it: what was read must not lead a kernel out of its arrays."""
    model = ObjectClass.load(folder).shape_model
    Geometry(model)
    points = model.vertices(np.ones((1, model.modes), np.float32))[0] + [-0.05, -0.05, 0.4]
    seen = rasterize(points, model.faces, np.eye(3), np.zeros(3), CAMERA)
    assert seen.face.max() < len(model.faces)


@pytest.mark.parametrize(
    ("name", "damage"),
    [("class.json", damaged_json), ("shape.safetensors", damaged_tensors), (TRANSFER_FILE, damaged_tensors)],
)
def test_damaged_class_packs(name: str, damage: Damage, pack: Path) -> None:
    read_damaged(pack / name, damage, lambda _: drawn(pack), 100, 1, 40)


def test_damaged_weights(pack: Path) -> None:
    photo = np.full((1, 150, 150, 3), 0.5, np.float32)
    path = pack / "recognition.safetensors"
    read_damaged(path, damaged_tensors, lambda path: Recognizer(path)(photo), 60, 2, 15)


def test_damaged_weights_of_the_papers_networks(tmp_path: Path) -> None:
    torch.manual_seed(0)
    networks = PaperNetworks(PaperSettings(2, 8, (1, 1, 1), (2, 2)))
    path = tmp_path / "recognition.safetensors"
    tensors = {f"network.{k}": v.numpy() for k, v in networks.state_dict().items()}
    settings = '{"modes": 2, "azimuth_bins": 8, "filters": [1, 1, 1], "dense": [2, 2], "dropout": 0.5}'
    save_file(tensors, path, {"net": "paper", "format": FORMAT, "settings": settings})
    read_damaged(path, damaged_tensors, PaperRecognizer, 40, 3, 10)


def test_damaged_calibrations(pack: Path) -> None:
    features = np.zeros(len(CONFIDENCE_FEATURES))

    def used(path: Path) -> None:
        calibration = FitCalibration.load(path)
        assert 0 <= calibration.confidence(features) <= 1
        widened = calibration.widen_deviations(np.ones(calibration.scale.shape[1]), features, True)
        assert np.isfinite(widened).all()

    read_damaged(pack / "calibration.json", damaged_json, used, 100, 4, 40)


@pytest.mark.parametrize(
    ("changed", "why"),
    [({"format": 99}, "it is of format 99"), ({"scale": [[-1.0] * 16] * 2}, "must not be negative")],
)
def test_calibrations_of_another_format_or_sign(changed: dict[str, Any], why: str, pack: Path) -> None:
    path = pack / "calibration.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | changed))
    with pytest.raises(UserError, match=why):
        FitCalibration.load(path)


def test_features_that_an_earlier_version_did_not_have_have_no_weight(pack: Path) -> None:
    path = pack / "calibration.json"
    stored = json.loads(path.read_text())
    before = FitCalibration.load(path)
    kept = [name for name in CONFIDENCE_FEATURES[::-1] if name != "rival_log_probability"]
    weights = {name: list(range(len(kept))) for name in stored if name.endswith("_weights")}
    path.write_text(json.dumps(stored | weights | {"features": kept}))
    after = FitCalibration.load(path)
    assert after.view_weights.tolist() == [*range(len(kept))][::-1] + [0.0]
    assert after.threshold == before.threshold
    path.write_text(json.dumps(stored | {"features": [*CONFIDENCE_FEATURES[:-1], "taste"]}))
    with pytest.raises(UserError, match="learned with different confidence features"):
        FitCalibration.load(path)


@pytest.mark.parametrize(
    "blocks",
    ["[1, 1180591620717411303424, 3, 1, 1]", "[1, 99999999, 3, 1, 1]", "[0, 1]", '["a", 1, 2, 1, 1]'],
)
def test_settings_of_monstrous_networks(blocks: str, pack: Path) -> None:
    path = pack / "recognition.safetensors"
    data = path.read_bytes().replace(
        rb"\"blocks\": [1, 1, 1, 1, 1]", rb"\"blocks\": " + blocks.replace('"', '\\"').encode()
    )
    (length,) = struct.unpack("<Q", path.read_bytes()[:8])
    grown = length + len(data) - path.stat().st_size
    path.write_bytes(struct.pack("<Q", grown) + data[8:])
    with pytest.raises(UserError, match="blocks"):
        Recognizer(path)


def test_a_calibration_of_another_class(pack: Path) -> None:
    shutil.copy(PACKAGED / "teapot" / "calibration.json", pack)
    with pytest.raises(UserError, match="expected a calibration of the 16 latents of class 'box'; .* has 30"):
        calibration_of(ObjectClass.load(pack))


@pytest.mark.parametrize(
    ("name", "at", "value", "why"),
    [
        ("faces", (5, 2), 5_000_000, "faces must be from 0 to 7; they are from 0 to 5000000"),
        ("faces", (0, 0), -7, "faces must be from 0 to 7; they are from -7"),
        ("mean", (3, 1), np.nan, "'mean' has numbers that are not finite"),
        ("parts", 2, 1, "parts must be from 0 to 0; they are from 0 to 1"),
        ("faces", None, np.zeros((12, 3), np.int64), "faces must be int32; it is int64"),
        ("basis", None, None, "'basis' is missing"),
        ("mean", None, CUBE[:5], r"basis must be \(2, 5, 3\)"),
    ],
)
def test_what_is_wrong_with_shapes_is_said(name: str, at: Any, value: Any, why: str, pack: Path) -> None:
    """An index out of range once ended in a corrupted heap."""
    arrays = load_file(pack / "shape.safetensors")
    if at is not None:
        arrays[name][at] = value
    elif value is None:
        del arrays[name]
    else:
        arrays[name] = value
    save_file(arrays, pack / "shape.safetensors")
    with pytest.raises(UserError, match=f"expected a class's shapes at .*{why}.*Build or copy it again"):
        ObjectClass.load(pack)
