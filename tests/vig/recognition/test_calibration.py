"""Uncertainties that were stated too small or too large are put right, and the weights carry it."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
import torch

from tests.vig.recognition.test_training import tiny_dataset
from vig.errors import UserError
from vig.recognition import NetworkSettings, RecognitionNetwork, Recognizer, calibrate
from vig.recognition.calibrating import view_levels
from vig.recognition.calibration import temperature, widening
from vig.recognition.checkpoint import save_weights
from vig.recognition.targets import azimuth_labels


def test_temperature_undoes_a_factor_of_the_logits() -> None:
    generator = torch.Generator().manual_seed(0)
    logits = torch.randn(20000, 6, generator=generator)
    drawn = torch.multinomial(logits.softmax(1), 1, generator=generator)[:, 0]
    labels = torch.nn.functional.one_hot(drawn, 6).float()
    assert float(temperature(3 * logits, labels)) == pytest.approx(3, rel=0.08)


def test_widening_makes_nine_in_ten_intervals_hold() -> None:
    error = torch.randn(50000, 2, generator=torch.Generator().manual_seed(0)) * torch.tensor([2.0, 0.5])
    assert widening(error, torch.ones(50000, 2)).tolist() == pytest.approx([2.0, 0.5], rel=0.03)


def test_levels_of_views_are_uniform_when_what_is_said_is_true() -> None:
    azimuth = torch.rand(20000, generator=torch.Generator().manual_seed(0)) * 2 * math.pi
    said = azimuth + 0.3 * torch.randn(20000, generator=torch.Generator().manual_seed(1))
    logits = azimuth_labels(said, 72, spread=0.3).clamp_min(1e-30).log()
    levels = view_levels(logits, azimuth)
    for stated in (0.25, 0.5, 0.9):
        assert float((levels <= stated).float().mean()) == pytest.approx(stated, abs=0.04)


def test_weights_are_calibrated_in_place(tmp_path: Path) -> None:
    torch.manual_seed(0)
    path = tmp_path / "recognition.safetensors"
    scale = {"mean": torch.zeros(23), "deviation": torch.full((23,), 0.1)}
    save_weights(RecognitionNetwork(NetworkSettings(widths=(4, 4, 8), features=16)), scale, path)
    dataset, said = tiny_dataset(tmp_path, 60), list[str]()
    before = Recognizer(path)
    calibrate(path, [dataset], said.append)
    after = Recognizer(path)
    assert (before.calibration.deviation == 1).all()
    assert (after.calibration.deviation > 2).all()  # it states a tenth of what its errors are
    assert torch.equal(before.network.azimuth.weight, after.network.azimuth.weight)
    assert (tmp_path / "reliability.png").stat().st_size > 1000 and "calibrated on 60 images" in said[0]
    calibrate(path, [dataset], said.append)  # from what the network says, not from what was put right before
    assert torch.equal(Recognizer(path).calibration.deviation, after.calibration.deviation)


def test_too_few_images_calibrate_nothing(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="at least 50 images"):
        calibrate(tmp_path / "w", [tiny_dataset(tmp_path, 20)])
