"""Uncertainties that were stated too small or too large are put right, and the weights carry it."""

from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors import safe_open
from safetensors.torch import load_file, save_file

from tests.support import SMALL
from tests.vig_train.training.test_training import tiny_dataset
from vig.io.errors import UserError
from vig.recognition import NetworkCalibration, Recognizer
from vig.scene import Latents, linear_from_srgb
from vig_train.network.network import RecognitionNetwork
from vig_train.network.weights import as_tensors
from vig_train.training.calibration import calibrate_network, deviation_factors, fit_temperature
from vig_train.training.checkpoint import save_weights
from vig_train.training.targets import numbers_of


def test_temperature_undoes_a_factor_of_the_logits() -> None:
    generator = torch.Generator().manual_seed(0)
    logits = torch.randn(20000, 6, generator=generator)
    drawn = torch.multinomial(logits.softmax(1), 1, generator=generator)[:, 0]
    labels = torch.nn.functional.one_hot(drawn, 6).float()
    assert float(fit_temperature(3 * logits, labels)) == pytest.approx(3, rel=0.08)


def test_widening_makes_nine_in_ten_intervals_hold() -> None:
    error = torch.randn(50000, 2, generator=torch.Generator().manual_seed(0)) * torch.tensor([2.0, 0.5])
    assert deviation_factors(error, torch.ones(50000, 2)).tolist() == pytest.approx([2.0, 0.5], rel=0.03)


def test_what_never_varies_keeps_half_of_its_stated_deviation() -> None:
    error = torch.tensor([0.0, 0.3]).expand(100, -1)
    assert deviation_factors(error, torch.ones(100, 2)).tolist() == [0.5, 0.5]


def test_weights_are_calibrated_in_place(tmp_path: Path) -> None:
    torch.manual_seed(0)
    path = tmp_path / "recognition.safetensors"
    scale = {"mean": torch.zeros(23), "deviation": torch.full((23,), 0.1)}
    save_weights(RecognitionNetwork(SMALL), scale, path)
    dataset = tiny_dataset(tmp_path, 60)
    before = Recognizer(path)
    result = calibrate_network(path, [dataset])
    after = Recognizer(path)
    assert (before.calibration.deviation == 1).all()
    assert (after.calibration.deviation > 2).all()  # it states a tenth of what its errors are
    assert np.array_equal(before.weights["azimuth.weight"], after.weights["azimuth.weight"])
    latents = Latents.from_vector(torch.from_numpy(dataset.latents))
    photos = linear_from_srgb(dataset.read("rgb") / 255).astype(np.float32)
    truth = numbers_of(latents).numpy()
    found = after(photos)
    held = np.abs(found.numbers - truth) <= 1.6449 * found.deviation
    assert held.mean(0) == pytest.approx(0.9, abs=0.035), "54 of 60, two more or less"
    assert np.array_equal(result.calibration.deviation, after.calibration.deviation)
    np.testing.assert_allclose(
        result.standard_errors,
        (before(photos).numbers - truth) / before(photos).deviation,
        atol=1e-2,
        rtol=1e-2,
    )
    calibrate_network(path, [dataset])  # from the network as trained, not as calibrated before
    assert np.array_equal(Recognizer(path).calibration.deviation, after.calibration.deviation)


def test_a_calibration_in_the_weights_changes_what_is_predicted(tmp_path: Path) -> None:
    """Logits divided by 2 give the square root of each probability, made to add up to 1 again.

    The mask's are divided by 4 before they are interpolated, which is linear: the fourth root. Deviations
    are multiplied by their factors.
    """
    torch.manual_seed(0)
    scale = {"mean": torch.zeros(23), "deviation": torch.ones(23)}
    plain, warm = tmp_path / "plain.safetensors", tmp_path / "warm.safetensors"
    save_weights(RecognitionNetwork(SMALL), scale, plain)
    factors = np.linspace(0.5, 3, 23, dtype=np.float32)
    made = NetworkCalibration(*(np.float32(each) for each in (2, 4)), factors)
    with safe_open(plain, framework="pt") as file:
        save_file(load_file(plain) | as_tensors(made.tensors()), warm, metadata=file.metadata())
    photos = np.random.default_rng(0).random((2, 150, 150, 3), np.float32)
    before, after = Recognizer(plain)(photos), Recognizer(warm)(photos)
    for probability, tempered, power in (
        (before.azimuth, after.azimuth, 1 / 2),
        (before.mask, after.mask, 1 / 4),
    ):
        root = probability**power
        expected = root / root.sum(-1, keepdims=True)
        assert np.abs(expected - probability).max() > 1e-3, "or nothing is tested"
        np.testing.assert_allclose(tempered, expected, atol=1e-5, rtol=1e-3)
    np.testing.assert_allclose(after.deviation, before.deviation * factors, rtol=1e-6)
    assert np.array_equal(after.numbers, before.numbers)


def test_too_few_images_calibrate_nothing(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="at least 50 images"):
        calibrate_network(tmp_path / "w", [tiny_dataset(tmp_path, 20)])
