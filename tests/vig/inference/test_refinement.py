"""Where the descents begin."""

import math

import torch

from vig.inference import starts
from vig.recognition import Prediction
from vig.scene import regressed_layout

LAYOUT = regressed_layout(10)


def prediction(peaks: dict[int, float]) -> Prediction:
    azimuth = torch.full((1, 72), 1e-6)
    for bin_, weight in peaks.items():
        azimuth[0, bin_] = weight
    numbers = torch.zeros(1, 23)
    numbers[0, LAYOUT["elevation"]], numbers[0, LAYOUT["albedo"]] = 0.5, 0.5
    numbers[0, LAYOUT.at("light")] = 2.356
    return Prediction(
        azimuth / azimuth.sum(),
        numbers,
        torch.ones(1, 23),
        torch.full((1, 150, 150, 3), 1 / 3),
        torch.zeros(1),
        torch.ones(1),
    )


def test_first_start_is_the_best_guess_and_the_same_seed_gives_the_same_starts():
    given = prediction({10: 0.7, 40: 0.3})
    found = starts(given, 16)
    assert torch.allclose(found.to_vector()[0], given.best().to_vector()[0], atol=1e-6)
    assert torch.equal(found.to_vector(), starts(given, 16).to_vector())


def test_every_likely_peak_gets_starts_in_proportion_and_unlikely_ones_none():
    found = starts(prediction({10: 0.7, 40: 0.29, 60: 0.01}), 16)
    degrees = torch.rad2deg(found.azimuth) % 360
    near_first = ((degrees - 52.5).abs() < 35).sum()
    near_second = ((degrees - 202.5).abs() < 35).sum()
    assert near_first + near_second == 16
    assert 9 <= near_first <= 13
    assert ((degrees - 302.5).abs() > 20).all()


def test_starts_stay_within_bounds():
    found = starts(prediction({0: 1.0}), 64)
    assert (found.elevation >= 0).all()
    assert (found.elevation <= math.pi / 2).all()
    assert (found.shape.abs() <= 3).all()


def test_starts_are_perturbed_by_eight_degrees_and_seven_tenths_of_the_stated_deviations():
    """511 draws: their standard deviation is known to 3 %."""
    given = prediction({10: 1.0})
    given.numbers[0, LAYOUT["elevation"]] = 0.8
    given.deviation[:, LAYOUT["elevation"]] = 0.1
    given.deviation[:, LAYOUT["shape"]] = 0.5
    found = starts(given, 512)
    azimuth = torch.rad2deg(found.azimuth[1:])
    assert abs(float(azimuth.mean()) - 52.5) < 1.5
    assert abs(float(azimuth.std()) / 8 - 1) < 0.1
    assert abs(float(found.elevation[1:].std()) / (0.7 * 0.1) - 1) < 0.1
    assert abs(float(found.shape[1:].std()) / (0.7 * 0.5) - 1) < 0.05
    assert torch.equal(found.albedo, given.best().albedo.expand(512, -1)), "solved soon enough"
