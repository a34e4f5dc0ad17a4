"""Damaged class packs, weights and calibrations: read to what can be drawn, or refused in a line."""

from __future__ import annotations

import shutil
import struct
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors.numpy import load_file, save_file

from tests.fuzz.mutations import damaged_json, damaged_tensors, outcomes
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


def mutants(
    path: Path, damage: Callable[[bytes, np.random.Generator], bytes], count: int, seed: int
) -> Iterator[Path]:
    """The same file `count` times with other damage each; whole again at the end."""
    whole, rng = path.read_bytes(), np.random.default_rng(seed)
    for _ in range(count):
        path.write_bytes(damage(whole, rng))
        yield path
    path.write_bytes(whole)


def drawn(folder: Path) -> None:
    """Read a class and draw it: what was read must not lead a kernel out of its arrays."""
    model = ObjectClass.load(folder).shape_model
    Geometry(model)
    points = model.vertices(np.ones((1, model.modes), np.float32))[0] + [-0.05, -0.05, 0.4]
    seen = rasterize(points, model.faces, np.eye(3), np.zeros(3), CAMERA)
    assert seen.face.max() < len(model.faces)


@pytest.mark.parametrize(
    ("name", "damage", "least"),
    [
        ("class.json", damaged_json, 150),
        ("shape.safetensors", damaged_tensors, 150),
        (TRANSFER_FILE, damaged_tensors, 150),
    ],
)
def test_damaged_class_packs(name: str, damage: Callable, least: int, pack: Path) -> None:
    drawn(pack)
    counts = outcomes(mutants(pack / name, damage, 300, 1), lambda _: drawn(pack))
    assert counts.total() == 300 and counts["refused"] > least
    drawn(pack)


def test_damaged_weights(pack: Path) -> None:
    path = pack / "recognition.safetensors"

    def predicted(path: Path) -> None:
        Recognizer(path)(np.full((1, 150, 150, 3), 0.5, np.float32))

    predicted(path)
    counts = outcomes(mutants(path, damaged_tensors, 300, 2), predicted)
    assert counts.total() == 300 and counts["refused"] > 100


def test_damaged_weights_of_the_papers_networks(tmp_path: Path) -> None:
    torch.manual_seed(0)
    networks = PaperNetworks(PaperSettings(2, 8, (1, 1, 1), (2, 2)))
    path = tmp_path / "recognition.safetensors"
    tensors = {f"network.{k}": v.numpy() for k, v in networks.state_dict().items()}
    settings = '{"modes": 2, "azimuth_bins": 8, "filters": [1, 1, 1], "dense": [2, 2], "dropout": 0.5}'
    save_file(tensors, path, {"net": "paper", "format": FORMAT, "settings": settings})
    PaperRecognizer(path)
    counts = outcomes(mutants(path, damaged_tensors, 100, 3), PaperRecognizer)
    assert counts.total() == 100 and counts["refused"] > 30


def test_damaged_calibrations(pack: Path) -> None:
    path = pack / "calibration.json"
    features = np.zeros(len(CONFIDENCE_FEATURES))

    def used(path: Path) -> None:
        calibration = FitCalibration.load(path)
        assert 0 <= calibration.confidence(features) <= 1
        widened = calibration.widened(np.ones(calibration.scale.shape[1]), features, True)
        assert np.isfinite(widened).all()

    used(path)
    counts = outcomes(mutants(path, damaged_json, 400, 4), used)
    assert counts.total() == 400 and counts["refused"] > 200


@pytest.mark.parametrize(
    "blocks",
    [
        "[1, 1180591620717411303424, 3, 1, 1]",
        "[1, 99999999, 3, 1, 1]",
        "[0, 1]",
        '["a", 1, 2, 1, 1]',
    ],
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


def out_of_range(arrays: dict[str, np.ndarray]) -> None:
    arrays["faces"][5] = [0, 1, 5_000_000]


def negative(arrays: dict[str, np.ndarray]) -> None:
    arrays["faces"][0, 0] = -7


def wide(arrays: dict[str, np.ndarray]) -> None:
    arrays["faces"] = arrays["faces"].astype(np.int64)


def infinite(arrays: dict[str, np.ndarray]) -> None:
    arrays["mean"][3, 1] = np.nan


def strange_part(arrays: dict[str, np.ndarray]) -> None:
    arrays["parts"][2] = 1


@pytest.mark.parametrize(
    ("spoil", "why"),
    [
        (out_of_range, "faces must be from 0 to 7; they are from 0 to 5000000"),
        (negative, "faces must be from 0 to 7; they are from -7"),
        (wide, "faces must be int32; it is int64"),
        (infinite, "'mean' has numbers that are not finite"),
        (strange_part, "parts must be from 0 to 0; they are from 0 to 1"),
        (lambda arrays: arrays.pop("basis"), "'basis' is missing"),
        (lambda arrays: arrays.update(mean=arrays["mean"][:5]), r"basis must be \(2, 5, 3\)"),
    ],
)
def test_what_is_wrong_with_shapes_is_said(spoil: Callable, why: str, pack: Path) -> None:
    arrays = load_file(pack / "shape.safetensors")
    spoil(arrays)
    save_file(arrays, pack / "shape.safetensors")
    with pytest.raises(UserError, match=f"expected a class's shapes at .*{why}.*Build or copy it again"):
        ObjectClass.load(pack)


@pytest.mark.slow
def test_fit_refuses_faces_out_of_range(tmp_path: Path) -> None:
    """In a process of its own: it used to end in a corrupted heap."""
    shutil.copytree(PACKAGED / "teapot", tmp_path / "pack")
    arrays = load_file(tmp_path / "pack" / "shape.safetensors")
    arrays["faces"][100:110] = 5_000_000
    save_file(arrays, tmp_path / "pack" / "shape.safetensors")
    photo = next((PACKAGED.parents[1] / "vig_app" / "examples").glob("*.png"))
    command = [sys.executable, "-c", "from vig_app.cli.main import main; main()", "fit", str(photo)]
    command += ["--out", str(tmp_path / "out"), "--class", str(tmp_path / "pack")]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert ended.returncode == 2, ended.stderr
    assert ended.stderr.count("\n") == 1 and "faces must be from 0 to 2635" in ended.stderr
    assert not (tmp_path / "out").exists()
