"""What people look at of a training and of a network's calibration."""

import csv
import math
import re
from pathlib import Path

import numpy as np
import pytest
import torch

from tests.support import SMALL
from tests.vig_train.training.test_training import tiny_dataset
from vig.recognition import NetworkCalibration
from vig_train.plots import TrainingLog, describe_calibration, plot_reliability, view_levels
from vig_train.training.calibration import CalibrationResult
from vig_train.training.targets import azimuth_labels
from vig_train.training.training import Epoch, TrainingSettings, train


def test_levels_of_views_are_uniform_when_what_is_said_is_true() -> None:
    azimuth = torch.rand(20000, generator=torch.Generator().manual_seed(0)) * 2 * math.pi
    said = azimuth + 0.3 * torch.randn(20000, generator=torch.Generator().manual_seed(1))
    logits = azimuth_labels(said, 72, spread=0.3).clamp_min(1e-30).log()
    levels = view_levels(logits, azimuth)
    for stated in (0.25, 0.5, 0.9):
        assert float((levels <= stated).float().mean()) == pytest.approx(stated, abs=0.04)


def test_a_calibration_is_summed_up_and_plotted(tmp_path: Path) -> None:
    """Errors of twice their stated deviation: logits ten times too large."""
    generator = torch.Generator().manual_seed(0)
    azimuth = torch.rand(2000, generator=generator) * 2 * math.pi
    said = azimuth + 0.3 * torch.randn(2000, generator=generator)
    logits = 10 * azimuth_labels(said, 72, spread=0.3).clamp_min(1e-30).log()
    made = NetworkCalibration(np.float32(10), np.float32(1.5), np.full(23, 2, np.float32))
    result = CalibrationResult(made, azimuth, logits, 2 * torch.randn(2000, 23, generator=generator))
    line = describe_calibration(result)
    assert (
        line.startswith("calibrated on 2000 images: ") and "(temperature 10.00)" in line and "\n" not in line
    )
    before, after, least, most = map(float, re.findall(r"([\d.]+)%", line))
    assert before < 60 and after == pytest.approx(90, abs=3)
    assert 55 < least <= most < 63, "a Gaussian of 2 within 1.645: 59 %"
    plot_reliability(tmp_path / "reliability.png", result)
    assert (tmp_path / "reliability.png").stat().st_size > 1000


def rows(folder: Path) -> list[dict[str, str]]:
    with open(folder / "log.csv", newline="") as file:
        return list(csv.DictReader(file))


def epoch(number: int, loss: float = 0.5) -> Epoch:
    return Epoch(number, {"azimuth": loss}, {"azimuth": 2 * loss}, {"azimuth_deg": 30.0, "mask_iou": 0.25})


def test_a_resumed_training_replaces_what_was_logged_after_its_checkpoint(tmp_path: Path) -> None:
    log = TrainingLog(tmp_path)
    for number in (1, 2, 3):
        log.add(epoch(number))
    TrainingLog(tmp_path).add(epoch(2, loss=0.125))
    found = rows(tmp_path)
    assert [row["epoch"] for row in found] == ["1", "2"]
    assert found[1] == {
        "epoch": "2",
        "train_azimuth": "0.125",
        "held_out_azimuth": "0.25",
        "azimuth_deg": "30",
        "mask_iou": "0.25",
    }
    assert (tmp_path / "losses.png").stat().st_size > 1000


def test_a_training_is_logged(tmp_path: Path) -> None:
    settings = TrainingSettings(epochs=1, batch=8, threads=1, network=SMALL)
    datasets = [tiny_dataset(tmp_path)]
    path = train(datasets, tmp_path, settings, lambda line: None, TrainingLog(tmp_path).add)
    assert path == tmp_path / "recognition.safetensors" and path.is_file()
    assert [row["epoch"] for row in rows(tmp_path)] == ["1"]
