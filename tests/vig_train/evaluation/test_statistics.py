"""Statistics of errors, on numbers whose answer is known."""

import numpy as np
import pytest

from vig.scene import Latents
from vig_train.evaluation import statistics
from vig_train.evaluation.results import MethodResult


def drawn(count: int, resamples: int = 1000) -> np.ndarray:
    return statistics.bootstrap_indices(count, np.random.default_rng(5), resamples)


def stating(latents: np.ndarray, deviation: np.ndarray, **errors: np.ndarray) -> MethodResult:
    found = Latents.from_vector(latents)
    return MethodResult(errors, [""] * len(latents), found, deviation)


def test_ranges_take_their_upper_end_and_zero() -> None:
    occlusion = np.array([0.0, 0.15, 0.16, 0.3])
    assert statistics.within_occlusion(occlusion, 0.0, 0.15).tolist() == [True, True, False, False]
    assert statistics.within_occlusion(occlusion, 0.15, 0.3).tolist() == [False, False, True, True]


def test_every_image_up_to_the_last_bin_is_in_one_bin() -> None:
    occlusion = np.linspace(0, 0.9, 200)
    assert (
        sum(statistics.within_occlusion(occlusion, *each).sum() for each in statistics.OCCLUSION_BINS) == 200
    )


def test_errors_by_occlusion() -> None:
    occlusion = np.array([0.1, 0.1, 0.1, 0.5])
    found = statistics.by_occlusion(
        np.array([1.0, 2.0, 6.0, 9.0]),
        occlusion,
        [(0.0, 0.2), (0.2, 0.4), (0.0, 0.9)],
        np.random.default_rng(0),
    )
    assert (found[0]["median"], found[0]["mean"], found[1], found[2]["mean"]) == (2.0, 3.0, None, 4.5)
    assert found[0]["ci95"] == [1.0, 6.0]


def test_failures_are_counted_beyond_thirty_degrees() -> None:
    found = statistics.failure_rate(np.array([30.0, 31.0, 0.0, 179.0]), drawn(4))
    assert (found["count"], found["rate"]) == (2, 0.5) and found["ci95"] == [0.0, 1.0]


def test_the_rates_interval_has_the_width_of_theory() -> None:
    # A rate of 0.2 among 1,000: standard error sqrt(0.2 x 0.8 / 1000) = 0.0126, the interval 0.0496 wide.
    azimuth = np.where(np.arange(1000) < 200, 90.0, 1.0)
    low, high = statistics.failure_rate(azimuth, drawn(1000))["ci95"]
    assert low < 0.2 < high and high - low == pytest.approx(0.0496, rel=0.1)


def test_pairs_that_differ_by_a_constant_are_told_apart_within_their_scatter() -> None:
    # Values scatter by 10, differences by nothing: a paired test sees 0.5 at once.
    first = np.random.default_rng(1).normal(scale=10, size=50)
    found = statistics.paired_difference(first + 0.5, first, drawn(50))
    assert found["median_difference"] == pytest.approx(0.5) and found["mean_difference"] == pytest.approx(0.5)
    np.testing.assert_allclose(found["ci95"] + found["mean_ci95"], [0.5] * 4)
    assert found["p"] < 1e-8


def test_pairs_alike_have_no_difference() -> None:
    found = statistics.paired_difference(np.ones(5), np.ones(5), drawn(5))
    assert found == {
        "median_difference": 0,
        "ci95": [0, 0],
        "mean_difference": 0,
        "mean_ci95": [0, 0],
        "p": 1,
    }


def test_wilcoxon_by_hand() -> None:
    # All of five differences are positive: one of 2^5 sign patterns, twice for both sides.
    first = np.array([1.0, 2.0, 3.0, 4.0, 5.0])
    assert statistics.paired_difference(first, np.zeros(5), drawn(5))["p"] == pytest.approx(2 / 32)


def test_standardised_errors_go_round_the_circle() -> None:
    truth, found = np.zeros((1, 24)), np.zeros((1, 24))
    truth[0, 10], found[0, 10] = 0.1, 2 * np.pi - 0.1
    truth[0, 0], found[0, 3] = 3.0, 1.0
    deviation = np.full((1, 24), 0.5)
    deviation[0, 3:5] = 0.0  # stated as certain: wrong in one, right in the other
    standard = statistics.standardised_errors(stating(found, deviation), truth)[0]
    assert standard[10] == pytest.approx(0.4) and standard[0] == 6.0
    assert standard[3] == np.inf and standard[4] == 0


def test_coverage_of_honest_and_of_boastful_deviations() -> None:
    # The share of 4,000 draws in a 90 % interval has a standard error of 0.5 %; within half the deviation
    # only 58.9 % lie.
    truth = np.random.default_rng(2).normal(size=(4000, 24)) * 0.3
    deviation = np.full((4000, 24), 0.3)
    deviation[:, 11] /= 2
    held = statistics.coverage(
        statistics.standardised_errors(stating(np.zeros((4000, 24)), deviation), truth)
    )
    assert held["azimuth"] == pytest.approx(0.9, abs=0.02) and held["light"] == pytest.approx(0.9, abs=0.01)
    assert held["elevation"] == pytest.approx(0.589, abs=0.03)
    assert set(held) == {
        "azimuth",
        "elevation",
        "shape",
        "albedo",
        "light",
        *(f"shape_{k}" for k in range(10)),
        *(f"albedo_{k}" for k in range(3)),
        *(f"light_{k}" for k in range(1, 9)),
    }


def test_pooled_coverage_is_the_mean_of_its_components() -> None:
    standard = np.zeros((2, 24))
    standard[:, 0] = standard[0, 1] = 2.0  # outside 1.645
    held = statistics.coverage(standard)
    assert (held["shape_0"], held["shape_1"], held["shape_2"]) == (0, 0.5, 1)
    assert held["shape"] == pytest.approx(1 - 3 / 20)


def test_what_states_nothing_has_no_coverage() -> None:
    with pytest.raises(ValueError, match="with latents and their deviations"):
        statistics.standardised_errors(MethodResult({}, [""]), np.zeros((1, 24)))


def test_verdicts_and_what_trust_is_worth() -> None:
    said = ["trusted", "trusted", "ambiguous", "trusted", "reverted"]
    result = MethodResult({"azimuth_deg": np.array([15.0, 16.0, 90.0, 1.0, 2.0])}, said)
    found = statistics.verdicts(result, np.array([True, True, True, False, True]))
    assert found == {
        "counts": {"ambiguous": 1, "reverted": 1, "trusted": 2},
        "trusted_share": 0.5,
        "trusted_within_15_deg": 0.5,
    }
    none = statistics.verdicts(result, np.array([False, False, True, False, False]))
    assert none["trusted_within_15_deg"] is None


def test_quarters_of_what_is_hidden_part_the_chosen_images() -> None:
    occlusion = np.array([0.0, 0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.9])
    chosen = occlusion < 0.8
    quarters = statistics.quarters_hidden(occlusion, chosen)
    assert list(quarters) == ["0% to 8% hidden", "8% to 25% hidden", "25% to 43% hidden", "43% to 60% hidden"]
    assert (sum(quarters.values()) == chosen).all()
    assert len(statistics.quarters_hidden(np.zeros(3), np.ones(3, bool))) == 1


def test_kinds_of_images_have_their_own_coverage_and_trust() -> None:
    found, deviation = np.zeros((4, 24)), np.full((4, 24), 0.1)
    truth = np.zeros((4, 24))
    truth[1, 10] = truth[2:, 11] = 1.0  # azimuth of one image, elevation of two
    errors = {
        "azimuth_deg": np.array([1.0, 57.0, 2.0, 3.0]),
        "segmentation_iou": np.array([0.9, 0.1, 0.8, 0.6]),
    }
    fits = stating(found, deviation, **errors)
    fits.verdicts[:] = ["trusted", "trusted", "trusted", "ambiguous"]
    first = np.array([True, True, False, False])
    kinds = statistics.by_kind({"spatial": fits}, {"first": first, "last": ~first}, truth)
    one, other = kinds["first"]["spatial"], kinds["last"]["spatial"]
    assert one["coverage"] == {"azimuth": 0.5, "elevation": 1.0}
    assert other["coverage"] == {"azimuth": 1.0, "elevation": 0.0}
    assert (one["count"], one["azimuth_deg"], one["within_15_deg"]) == (2, 29.0, 0.5)
    assert one["verdicts"]["trusted_within_15_deg"] == 0.5 and other["verdicts"]["trusted_share"] == 0.5
    assert other["segmentation_iou"] == pytest.approx(0.7)


def test_quarters_of_nearly_equal_shares_keep_all_images() -> None:
    occlusion = np.concatenate([np.linspace(0.0005, 0.004, 24), np.linspace(0.1, 0.9, 16)])
    quarters = statistics.quarters_hidden(occlusion, np.ones(40, bool))
    assert len(quarters) == 4 and sum(chosen.sum() for chosen in quarters.values()) == 40


def test_calibration_error_weighs_each_bins_gap_by_its_photos() -> None:
    confidence = np.array([0.9, 0.95, 1.0, 0.92, 0.2, 0.21, np.nan])
    right = np.array([1, 1, 1, 0, 0, 1, 1], bool)
    # Of the highest tenth (.9425 stated) 3 of 4 are right, of the third tenth (.205) 1 of 2.
    expected = (4 * (0.9425 - 0.75) + 2 * (0.5 - 0.205)) / 6
    assert statistics.expected_calibration_error(confidence, right) == pytest.approx(expected)
    assert statistics.expected_calibration_error(np.full(3, np.nan), right[:3]) is None
