"""Peaks of a distribution over azimuth."""

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.support import assert_close
from tests.vig.recognition.predictions import BINS, prediction_of, view_probabilities
from vig.recognition import Prediction

WIDTH = 360 / BINS


def of_azimuth(*rows: np.ndarray) -> Prediction:
    return prediction_of(np.stack(rows), np.zeros((len(rows), 23), np.float32), 1.0)


def bump(degrees: float, weight: float = 1.0) -> np.ndarray:
    return weight * view_probabilities(math.radians(degrees))[0]


def turn(a: float, degrees: float) -> float:
    return abs((math.degrees(a) - degrees + 180) % 360 - 180)


@pytest.mark.parametrize("degrees", [0.0, 2.5, 91.3, 359.6])
def test_one_peak_is_found_within_a_fraction_of_a_bin(degrees: float) -> None:
    weights, angles = of_azimuth(bump(degrees)).modes(1)
    assert weights.shape == angles.shape == (1, 1)
    assert turn(angles[0, 0], degrees) < 0.5 < WIDTH  # also across north, where bin 71 meets bin 0
    assert 0 <= angles[0, 0] <= 2 * math.pi
    assert np.exp(weights[0, 0]) > 0.95


def test_peaks_come_by_weight_and_apart() -> None:
    prediction = of_azimuth(bump(200, 0.3) + bump(20, 0.5) + bump(290, 0.2))
    weights, angles = prediction.modes(3)
    for angle, expected in zip(angles[0], (20, 200, 290), strict=True):
        assert turn(angle, expected) < 1.5
    assert_close(np.exp(weights[0]), np.array([0.5, 0.3, 0.2]), atol=0.02, rtol=0)


def test_a_bins_mass_counts_once() -> None:
    """What a peak has taken is gone: no peak is found twice and the weights add up to no more than 1."""
    weights, angles = of_azimuth(np.full(BINS, 1 / BINS, np.float32)).modes(10, broad=False)
    assert np.exp(weights[0]).sum() <= 1 + 1e-6
    gaps = np.diff(np.sort(np.degrees(angles[0])))
    assert (gaps > 4.9 * WIDTH).all()


def test_a_broad_peak_is_one_view() -> None:
    """All views that hide a handle are alike: the middle is nearest to all of them."""
    flat = np.zeros(BINS, np.float32)
    flat[45:63] = np.linspace(1.2, 1.0, 18)  # 225 to 315 degrees
    flat[10:13] = 0.8
    weights, angles = of_azimuth(flat / flat.sum()).modes(3)
    assert turn(angles[0, 0], 270.0) < 5
    assert turn(angles[0, 1], 57.5) < 2
    assert np.exp(weights[0, 0]) > 0.8
    narrow = of_azimuth(flat / flat.sum()).modes(1, broad=False)[1]
    assert turn(narrow[0, 0], 270.0) > 15


def test_a_peak_of_one_bin_leaves_nothing_for_the_next() -> None:
    weights, angles = of_azimuth(np.eye(BINS, dtype=np.float32)[7]).modes(2)
    assert turn(angles[0, 0], 7.5 * WIDTH) < 1e-3
    assert weights[0, 1] == pytest.approx(math.log(1e-9))
    assert np.isfinite(angles).all()


def test_rows_are_independent_and_slices_are_their_predictions() -> None:
    rows = [bump(40), 0.6 * bump(300) + 0.4 * bump(120)]
    both = of_azimuth(*rows)
    _, angles = both.modes(2)
    assert len(both) == 2 and len(both[1:2]) == 1 and np.array_equal(both[1:2].azimuth, both.azimuth[1:])
    for i, row in enumerate(rows):
        assert np.array_equal(angles[i], of_azimuth(row).modes(2)[1][0])


def test_the_best_guess_stands_at_the_heaviest_peak_within_bounds() -> None:
    prediction = of_azimuth(0.6 * bump(300) + 0.4 * bump(120))
    prediction.numbers[0] = [*[5.0] * 10, 2.0, 1.2, 0.4, -0.1, 2.0, 1.0, *[0.0] * 7]
    best = prediction.best()
    assert len(best) == 1 and turn(best.azimuth[0], 300) < 0.5
    assert best.elevation[0] == pytest.approx(math.pi / 2)
    assert (best.shape == 3).all()
    assert_close(best.albedo, np.float32([[1.0, 0.4, 0.0]]))
    # Light along +y in the heading frame: turned with the azimuth, (l, m) = (1, -1) is y and (1, 1) is x.
    angle = best.azimuth[0]
    expected = np.float32([2.0, np.cos(angle), 0.0, -np.sin(angle)])
    assert_close(best.light[0, :4], expected, atol=1e-5, rtol=0)


def test_log_mass_counts_two_bins_on_either_hand_and_never_rules_a_view_out() -> None:
    """At the centre of bin 10, bins 8 to 12 count and 7 and 13 do not; between two bins, the mean of both."""
    azimuth = np.zeros(72, np.float32)
    azimuth[7:14] = 0.03, 0.05, 0.1, 0.4, 0.2, 0.15, 0.07
    mass = np.exp(of_azimuth(azimuth).log_mass(np.radians(np.float32([52.5, 55.0, 200.0]))))
    here, next_one = 0.05 + 0.1 + 0.4 + 0.2 + 0.15, 0.1 + 0.4 + 0.2 + 0.15 + 0.07
    assert mass.tolist() == pytest.approx([here, (here + next_one) / 2, 0.001], abs=1e-5)
    north = np.zeros(72, np.float32)
    north[[1, 71]] = 0.8, 0.2
    mass = np.exp(of_azimuth(north).log_mass(np.radians(np.float32([357.5, 2.5]))))
    assert mass.tolist() == pytest.approx([1.0, 1.0], abs=1e-5)


def test_rounding_hides_a_last_digit_and_changes_little() -> None:
    rng = np.random.default_rng(3)
    size = 20
    mask = rng.dirichlet([0.3, 0.3, 0.3], (1, 40, 40)).astype(np.float32)
    numbers = rng.normal(size=(1, size)).astype(np.float32)
    deviation = rng.uniform(0.01, 1, (1, size)).astype(np.float32)
    azimuth = np.full((1, BINS), 1 / BINS, np.float32)
    one = Prediction(azimuth, numbers, deviation, mask, np.zeros(1, np.float32), np.ones(1, np.float32))
    other = replace(one, mask=mask * (1 + 1e-7), numbers=numbers + 1e-7, deviation=deviation * (1 + 1e-7))
    coarse = one.round_for_search()
    for name in ("mask", "numbers", "deviation"):
        assert not np.array_equal(getattr(one, name), getattr(other, name))
        assert np.array_equal(getattr(coarse, name), getattr(other.round_for_search(), name))
        assert np.array_equal(getattr(coarse, name), getattr(coarse.round_for_search(), name))
    assert np.abs(coarse.numbers - numbers).max() <= 1 / 1024
    assert_close(coarse.deviation, deviation, rtol=0.032, atol=0)
    seen = mask >= 0.02
    assert_close(coarse.mask[seen], mask[seen], rtol=0.065, atol=0)
    assert not coarse.mask[~seen].any()
    assert np.array_equal(coarse.azimuth, azimuth)
