"""Families: which one a predicted shape belongs to, and what it is within each, by hand."""

from dataclasses import replace

import numpy as np
import pytest

from tests.support import assert_close
from tests.vig.recognition.predictions import prediction_of_peaks
from vig.inference.families import family_of, family_shapes, shape_deviation
from vig.inference.refinement import starts
from vig.recognition import Prediction
from vig.scene import Family, ObjectClass

NEAR = Family("near", (-1.0, *[0.0] * 9), (0.5, *[1.0] * 9), 0.8)
FAR = Family("far", (3.0, *[0.0] * 9), (0.5, *[1.0] * 9), 0.2)


@pytest.fixture
def both(teapot: ObjectClass) -> ObjectClass:
    """The teapots as if they were of two families, apart along the first component."""
    return replace(teapot, families=(NEAR, FAR))


def predicted(first: float, deviation: float) -> Prediction:
    """A shape of which the first component is said to be `first`, all of that deviation."""
    made = prediction_of_peaks({10: 1.0})
    place = made.layout.at("shape")
    made.numbers[0, place] = first
    made.deviation[0, made.layout["shape"]] = deviation
    return made


def test_a_class_of_one_family_keeps_the_prediction(teapot: ObjectClass) -> None:
    made = predicted(0.7, 0.4)
    probability, shapes = family_shapes(made, teapot)
    assert probability.tolist() == [1.0] and np.array_equal(shapes, made.numbers[:, made.layout["shape"]])
    assert_close(shape_deviation(made, teapot), np.full(10, 0.4, np.float32))
    assert family_of(shapes[0], teapot) is None


def test_between_the_families_each_has_the_evidence_of_its_gaussian(both: ObjectClass) -> None:
    """At 1 both are as far: the shares stay. Deviations .5 and .5 meet half-way to each mean."""
    probability, shapes = family_shapes(predicted(1.0, 0.5), both)
    assert_close(probability, np.float32([0.8, 0.2]), atol=1e-5, rtol=0)
    assert_close(shapes[:, 0], np.float32([0.0, 2.0]))
    wide = shape_deviation(predicted(1.0, 0.5), both)
    assert wide[0] == pytest.approx((0.25 + 1.0) ** 0.5), "both are a unit away"
    assert wide[1] == pytest.approx(0.5)


def test_a_doubtful_prediction_goes_most_of_the_way_to_each_family(both: ObjectClass) -> None:
    """A deviation of 1 against .5 within a family: a fifth of the way is left, 1 / (1 + 4)."""
    _, shapes = family_shapes(predicted(1.0, 1.0), both)
    assert_close(shapes[:, 0], np.float32([-0.6, 2.6]))


def test_a_sure_prediction_is_of_one_family(both: ObjectClass) -> None:
    probability, _ = family_shapes(predicted(2.9, 0.1), both)
    assert probability[1] > 0.999
    assert family_of(np.float32([2.0, *[0.0] * 9]), both) == "far"
    assert family_of(np.zeros(10, np.float32), both) == "near"


def test_likely_families_share_the_starts_and_the_first_is_the_guess(both: ObjectClass) -> None:
    found = starts(predicted(1.0, 0.5), 16, both).shape[:, 0]
    assert found[0] == pytest.approx(1.0)
    far = (found[1:] > 1.0).mean()
    assert 0.1 < far < 0.5, "a fifth of the class, before perturbations"
    alone = starts(predicted(-1.0, 0.1), 16, both).shape[:, 0]
    assert np.abs(alone + 1.0).max() < 0.5
