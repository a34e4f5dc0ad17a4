"""What the recognition model states as its uncertainty, put into the latents' order."""

import math

import numpy as np
import pytest

from vig.recognition import Prediction
from vig.scene import Symmetry
from vig_train.evaluation.results import predicted_deviation


def prediction(azimuth: dict[int, float], deviation: np.ndarray) -> Prediction:
    """One photo's: probabilities of some of 72 bins, five degrees each; one shape component."""
    bins = np.zeros((1, 72), np.float32)
    for place, probability in azimuth.items():
        bins[0, place] = probability
    mask = np.zeros((1, 150, 150, 3), np.float32)
    return Prediction(bins, np.zeros((1, 14)), deviation[None], mask, np.zeros(1), np.ones(1))


def test_deviations_stand_in_the_latents_order() -> None:
    # One shape component, elevation, albedo, light; facing azimuth 2.5 degrees the light hardly turns.
    deviation = np.array([0.2, 0.1, 0.3, 0.4, 0.5, *[1.0] * 9])
    found = predicted_deviation(prediction({0: 1.0}, deviation))
    np.testing.assert_allclose(found, [[0.2, 0.0, 0.1, 0.3, 0.4, 0.5, *[1.0] * 9]], atol=1e-6)


def test_the_light_is_turned_into_the_world() -> None:
    # At azimuth 90 degrees the heading's x is the world's y: coefficients (1,-1) and (1,1) change places.
    deviation = np.ones(14)
    deviation[5 + 1], deviation[5 + 3] = 2.0, 3.0
    found = predicted_deviation(prediction({17: 0.5, 18: 0.5}, deviation))
    np.testing.assert_allclose(found[0, [7, 9]], [3.0, 2.0], rtol=1e-5)


def test_a_second_hypothesis_widens_the_azimuth() -> None:
    # A quarter of the mass lies 180 degrees off: root of 0.25 x 180 squared.
    found = predicted_deviation(prediction({10: 0.75, 46: 0.25}, np.ones(14)))
    assert math.degrees(found[0, 1]) == pytest.approx(90.0, abs=1e-3)


def test_a_view_that_looks_the_same_is_no_second_hypothesis() -> None:
    given = prediction({0: 0.5, 36: 0.5}, np.ones(14))
    assert predicted_deviation(given)[0, 1] > 1
    for symmetry in (Symmetry.HALF_TURN, Symmetry.ANY_TURN):
        assert predicted_deviation(given.fold(symmetry))[0, 1] == pytest.approx(0, abs=1e-6)
