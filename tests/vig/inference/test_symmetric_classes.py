"""Classes that look the same after a turn: their views are counted once, and not called ambiguous for it."""

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.support import assert_close
from tests.toys import toy
from tests.vig.recognition.predictions import prediction_of_peaks
from vig.inference import ExplainSettings, Fit, Verdict, explain_one, starts
from vig.recognition import Prediction
from vig.renderer import render_latents
from vig.scene import EXPOSURE_L00, Latents, ObjectClass, Symmetry, rotate_z

SETTINGS = ExplainSettings(calibrated=False, decoration=0.0)


def prediction(peaks: dict[int, float], symmetry: Symmetry) -> Prediction:
    """Peaks by the bin of the circle, and numbers that are known to a tenth."""
    return prediction_of_peaks(peaks, 3, 0.45, (EXPOSURE_L00, 0.0, 0.9, 0.6), 0.1, symmetry)


def test_bins_that_look_the_same_are_added() -> None:
    half = prediction({3: 0.3, 39: 0.5, 10: 0.2}, Symmetry.HALF_TURN)
    assert half.azimuth.shape == (1, 36)
    weights, angles = half.modes(2)
    assert_close(np.exp(weights[0]), np.array([0.8, 0.2]), atol=1e-3, rtol=0)
    assert_close(np.degrees(angles[0]), np.float32([17.5, 52.5]), atol=0.1, rtol=0)
    at = np.radians([17.5, 197.5, 107.5])
    assert_close(np.exp(half.log_mass(at)[:2]), np.full(2, 0.8), atol=1e-3, rtol=0)
    assert half.log_mass(at)[2] < math.log(0.01)
    assert len(half[0:1]) == 1 and Prediction.concatenate([half, half]).symmetry is Symmetry.HALF_TURN


def test_a_peak_across_the_fold_is_one_peak() -> None:
    weights, angles = prediction({35: 0.5, 0: 0.5}, Symmetry.HALF_TURN).modes(2)  # 177.5 and 2.5 degrees
    assert np.exp(weights[0, 0]) == pytest.approx(1, abs=1e-3)
    assert abs(Symmetry.HALF_TURN.difference(angles[0, 0], 0.0)) < 1e-3


def test_where_any_turn_looks_the_same_there_is_one_view() -> None:
    any_turn = prediction({3: 0.3, 39: 0.7}, Symmetry.ANY_TURN)
    weights, angles = any_turn.modes(4)
    assert weights.tolist() == [[0.0]] and angles.tolist() == [[0.0]]
    assert not any_turn.log_mass(np.array([0.0, 2.0])).any()


def test_starts_do_not_repeat_views_that_look_the_same() -> None:
    given = {3: 0.3, 39: 0.3, 20: 0.2, 56: 0.2}
    half = np.degrees(starts(prediction(given, Symmetry.HALF_TURN), 16).azimuth)
    assert ((half >= 0) & (half < 180)).all()
    near = [(np.abs(half - peak) < 30).sum() for peak in (17.5, 102.5)]
    assert sum(near) == 16 and 8 <= near[0] <= 12
    found = starts(prediction(given, Symmetry.ANY_TURN), 8)
    assert not found.azimuth.any() and found.elevation.std() > 0.02
    assert_close(found.light, found.light[:1].repeat(8, 0))


def photographed(one: ObjectClass, azimuth: float) -> tuple[np.ndarray, Latents]:
    """A photo before grey that `prediction` fits, and its latents."""
    light = np.zeros((1, 9), np.float32)
    light[0, [0, 2, 3]] = EXPOSURE_L00, 0.9, 0.6
    angle, elevation, grey = np.float32([azimuth]), np.float32([0.4]), np.full((1, 3), 0.5, np.float32)
    truth = Latents(np.zeros((1, 3), np.float32), angle, elevation, grey, rotate_z(light, angle))
    drawn = render_latents(truth, one, one.camera())
    uncovered = 1 - drawn.coverage[0, :, :, None].numpy()
    return drawn.rgb[0].numpy() + uncovered * np.float32([0.1, 0.2, 0.6]), truth


def fitted(kind: str, symmetry: str, peaks: dict[int, float]) -> Fit:
    one = toy(kind, symmetry=Symmetry(symmetry))
    photo, _ = photographed(one, math.radians(17.5))
    return explain_one(photo, prediction(peaks, one.symmetry), one, SETTINGS)


OPPOSITE = {3: 0.5, 39: 0.5}
"""The bins of 17.5 degrees and of the view from behind."""


def test_a_class_that_looks_the_same_from_behind_is_ambiguous_only_where_it_does_not_say_so() -> None:
    undeclared, declared = fitted("fins", "none", OPPOSITE), fitted("fins", "half-turn", OPPOSITE)
    assert undeclared.verdict is Verdict.AMBIGUOUS and "turned by 180 degrees" in undeclared.reason
    assert declared.verdict is Verdict.TRUSTED and not declared.alternatives
    assert np.degrees(declared.latents.azimuth) == pytest.approx(17.5, abs=2)
    assert np.degrees(declared.latents.elevation) == pytest.approx(math.degrees(0.4), abs=2)


def test_a_fit_beyond_the_fold_is_told_within_it() -> None:
    """The prediction is 2.5 degrees, the truth 17.5 degrees on the other side."""
    one = toy("fins", symmetry=Symmetry.HALF_TURN)
    photo, truth = photographed(one, math.radians(-10))
    fit = explain_one(photo, prediction({0: 1.0}, one.symmetry), one, SETTINGS)
    assert np.degrees(fit.latents.azimuth) == pytest.approx(170, abs=2)
    aligned = Symmetry.HALF_TURN.nearest(truth, fit.latents.azimuth)
    assert fit.latents.light[0, 3] == pytest.approx(aligned.light[0, 3], abs=0.15)


def test_azimuth_is_held_where_it_means_nothing() -> None:
    fit = fitted("post", "any-turn", {3: 0.4, 30: 0.3, 50: 0.3})
    assert fit.verdict is Verdict.TRUSTED
    assert fit.latents.azimuth == 0 and fit.deviation[3] == 0
    assert np.degrees(fit.latents.elevation) == pytest.approx(math.degrees(0.4), abs=2)
    # The light is as the eye sees it: 0.6 from its right.
    assert fit.latents.light[0, 3] == pytest.approx(0.6, abs=0.15)


def test_fits_do_not_depend_on_the_size_of_things() -> None:
    small, large = (toy("fin", size) for size in (0.25, 1.0))
    found = []
    for one in (small, replace(large, viewing_distance=4 * small.viewing_distance)):
        photo, _ = photographed(one, math.radians(17.5))
        found.append(explain_one(photo, prediction({3: 1.0}, one.symmetry), one, SETTINGS))
    assert_close(found[0].latents.to_vector(), found[1].latents.to_vector(), atol=0.01, rtol=0)
