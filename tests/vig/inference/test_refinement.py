"""Where the descents begin."""

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.support import assert_close
from tests.vig.recognition.predictions import prediction_of_peaks
from vig.inference import ExplainSettings, starts
from vig.inference.posterior import objective_of
from vig.inference.refinement import (
    AZIMUTH_SPREAD,
    ExpectedStart,
    framing_of_box,
    framings,
    refine,
    select_for_stage,
)
from vig.inference.settings import Stage, for_tracking, resolve
from vig.recognition.prediction import START_STEP, round_to_grid
from vig.renderer import render_latents
from vig.scene import ObjectClass, Symmetry, regressed_layout

LAYOUT = regressed_layout(10)
GREY = np.full((150, 150, 3), 0.5, np.float32)


def test_first_start_is_the_best_guess_and_the_same_seed_gives_the_same_starts():
    given = prediction_of_peaks({10: 0.7, 40: 0.3})
    found = starts(given, 16)
    assert np.allclose(found.to_vector()[0], given.best().to_vector()[0], atol=1e-6)
    assert np.array_equal(found.to_vector(), starts(given, 16).to_vector())


def test_every_likely_peak_gets_starts_in_proportion_and_unlikely_ones_none():
    found = starts(prediction_of_peaks({10: 0.7, 40: 0.29, 60: 0.01}), 16)
    degrees = np.degrees(found.azimuth) % 360
    near_first = (np.abs(degrees - 52.5) < 35).sum()
    near_second = (np.abs(degrees - 202.5) < 35).sum()
    assert near_first + near_second == 16
    assert 9 <= near_first <= 13
    assert (np.abs(degrees - 302.5) > 20).all()


def test_starts_stay_within_bounds():
    found = starts(prediction_of_peaks({0: 1.0}), 64)
    assert (found.elevation >= 0).all()
    assert (found.elevation <= math.pi / 2).all()
    assert (np.abs(found.shape) <= 3).all()


def test_starts_are_perturbed_by_eight_degrees_and_seven_tenths_of_the_stated_deviations():
    """511 draws: their standard deviation is known to 3 %."""
    given = prediction_of_peaks({10: 1.0})
    given.numbers[0, LAYOUT["elevation"]] = 0.8
    given.deviation[:, LAYOUT["elevation"]] = 0.1
    given.deviation[:, LAYOUT["shape"]] = 0.5
    found = starts(given, 512)
    azimuth = np.degrees(found.azimuth[1:])
    assert abs(azimuth.mean() - 52.5) < 1.5
    assert abs(azimuth.std() / 8 - 1) < 0.1
    assert abs(found.elevation[1:].std() / (0.7 * 0.1) - 1) < 0.1
    assert abs(found.shape[1:].std() / (0.7 * 0.5) - 1) < 0.05
    assert (found.albedo == given.best().albedo).all(), "solved soon enough"


@pytest.mark.parametrize("elevation", [0.1, 1.2])
def test_a_start_is_framed_so_that_its_outline_has_the_box_of_the_predicted_mask(
    teapot: ObjectClass, elevation: float
) -> None:
    given = prediction_of_peaks({10: 1.0})
    given.numbers[0, LAYOUT["elevation"]] = elevation
    given.mask[:] = 0.0, 0.0, 1.0
    given.mask[:, 40:70, 30:80] = 0.6, 0.3, 0.1
    settings = ExplainSettings(free_framing=True)
    objective = objective_of(GREY, given, teapot, settings)
    begin = starts(given, 6, teapot)
    found = framings(begin, given, objective)
    assert found.shape == (6, 4) and len(np.unique(found, axis=0)) == 6, "the others are perturbed"
    camera = objective.likelihood.camera.apply_framing(*found[0].tolist())
    cover = render_latents(given.best(), teapot, camera, samples=2).coverage[0].numpy() > 0.5
    rows, columns = np.flatnonzero(cover.any(1)), np.flatnonzero(cover.any(0))
    box = [columns[0], rows[0], columns[-1] + 1, rows[-1] + 1]
    centre = ((box[0] + box[2]) / 2, (box[1] + box[3]) / 2)
    assert centre == pytest.approx((55, 55), abs=1)
    assert (box[2] - box[0]) * (box[3] - box[1]) == pytest.approx(1500, rel=0.06)


def test_where_the_mask_shows_nothing_the_first_start_is_not_moved(teapot: ObjectClass) -> None:
    given = prediction_of_peaks({10: 1.0})
    given.mask[:] = 0.0, 0.0, 1.0
    settings = ExplainSettings(free_framing=True)
    objective = objective_of(GREY, given, teapot, settings)
    assert not framings(starts(given, 2, teapot), given, objective)[0].any()


def test_half_of_the_starts_go_on_by_score_the_others_by_view() -> None:
    """By score: 0, 1, 2, 4, 3, 5. Of 4, the first two; then the best beyond 25 degrees of all chosen."""
    azimuth = np.radians([0.0, 5.0, 350.0, 90.0, 95.0, 180.0])
    scores = np.array([10.0, 9.0, 8.0, 1.0, 2.0, 0.0])
    for count, expected in ((4, [0, 1, 4, 5]), (5, [0, 1, 2, 4, 5]), (6, [0, 1, 2, 4, 5, 3]), (1, [0])):
        assert select_for_stage(azimuth, scores, count).tolist() == expected
    assert select_for_stage(azimuth, scores, 4, one_per_view=True).tolist() == [0, 4, 5]
    # A view that looks the same is no other view.
    azimuth, scores = np.radians([10.0, 190.0, 100.0, 12.0]), np.array([9.0, 8, 1, 7])
    for symmetry, second in ((Symmetry.NONE, 1), (Symmetry.HALF_TURN, 2), (Symmetry.ANY_TURN, 1)):
        assert select_for_stage(azimuth, scores, 2, symmetry).tolist() == [0, second]


def test_an_expected_start_is_tried_and_of_the_networks_those_elsewhere(teapot: ObjectClass) -> None:
    given = prediction_of_peaks({10: 0.6, 40: 0.4})
    settings = replace(for_tracking(resolve(ExplainSettings(), teapot, photo=True)), stages=(Stage(3, 0),))
    objective = objective_of(GREY, given, teapot, settings)
    latents, box = given.best(), (0.2, 0.3, 0.5, 0.4)

    def turns(expected: float) -> list[float]:
        start = replace(latents, azimuth=latents.azimuth + expected)
        ends = refine({1.0: objective}, given, settings, ExpectedStart(start, box, lambda _: given))
        framing = round_to_grid(framing_of_box(start, box, objective), START_STEP)
        assert_close(objective.framing(ends.points[:1]), framing)
        return (objective.latents(ends.points).azimuth - latents.azimuth).tolist()

    other = math.radians(150)  # the network's second peak
    near, far = 0.5 * AZIMUTH_SPREAD, 2 * AZIMUTH_SPREAD
    assert turns(near) == pytest.approx([near, other], abs=1e-3)
    assert turns(far) == pytest.approx([far, 0.0, other], abs=1e-3)
