"""The smooth gain of the shading: a shadow over the object bends neither its shape nor its view."""

import math
from dataclasses import dataclass, replace

import numpy as np
import pytest

from tests.support import assert_close
from tests.vig.recognition.predictions import prediction_of_latents
from vig.inference import ExplainSettings, explain_one
from vig.inference.posterior import objective_of
from vig.inference.refinement import Selection
from vig.inference.settings import PHOTO, PICTURE, for_tracking
from vig.inference.shading_gain import (
    BRIGHTEST,
    MAX_GAIN,
    MIN_GAIN,
    _divide_by_gain,
    _gain,
    with_shading_gain,
)
from vig.likelihood import GAUSSIAN
from vig.recognition import Prediction
from vig.scene import Latents, ObjectClass
from vig.search.levenberg_marquardt import LevenbergMarquardt
from vig.search.optimizer import Descent

SETTINGS = ExplainSettings(**PICTURE | {"decoration": 0.0}, self_shadow=False, calibrated=False)
NOISE = 0.05
VISIBLE = replace(SETTINGS, likelihood=GAUSSIAN)
"""Every pixel of the object is visible, however dark its shadow."""


def shaded(studio, shadow: np.ndarray | float = 1.0) -> tuple[np.ndarray, Latents, Prediction]:
    """A photo (H, W, 3) of the studio's whose object is in `shadow` (H, W), its truth, and that predicted."""
    rng = np.random.default_rng(3)
    truth = studio.latents(rng)
    _, coverage, _ = studio.render(truth)
    photo = studio.photo(rng, truth, noise=0.005)[0].astype(np.float32)
    amodal = (coverage[0] > 0.5).astype(np.float32)
    photo = photo * (1 + amodal * (shadow - 1))[..., None].astype(np.float32)
    mask = 0.7 * np.stack([amodal, 0 * amodal, 1 - amodal], -1) + 0.1
    return photo, truth, prediction_of_latents(truth, mask)


def falling(side: int = 150) -> np.ndarray:
    """A shadow (H, W) that falls from the left to the right."""
    return np.tile(np.linspace(1.1, 0.6, side), (side, 1))


def selected(point: np.ndarray, start_evidence: float = 0.0) -> Selection:
    """The selection of one point, as if a search had ended there."""
    return Selection(point, point, False, start_evidence, 1, math.inf, False, 0.0, point[:0], ())


def test_a_shadow_bends_the_shape_less_with_a_gain(studio, teapot: ObjectClass) -> None:
    photo, truth, prediction = shaded(studio, falling())
    plain = explain_one(photo, prediction, teapot, replace(SETTINGS, gain_deviation=0.0))
    found = explain_one(photo, prediction, teapot, SETTINGS)

    def off(latents: Latents) -> float:
        model = teapot.shape_model
        return np.linalg.norm(model.vertices(latents.shape) - model.vertices(truth.shape), axis=2).mean()

    assert off(found.latents) < 0.8 * off(plain.latents)
    assert found.evaluations > plain.evaluations
    assert np.array_equal(found.descent[-1:, :-4], found.latents.to_vector())


def test_the_gain_is_the_shadow(studio, teapot: ObjectClass) -> None:
    photo, truth, prediction = shaded(studio)
    objective = objective_of(photo, prediction, teapot, VISIBLE)
    point = objective.point(truth)
    rendered = objective.evaluate_one(point, NOISE, derivatives=False)
    darkened = falling()[..., None] * rendered.irradiance[0][..., None] * truth.albedo[0]
    covered = rendered.coverage[0] > 0.99
    darkened = np.where(covered[..., None], darkened, photo).astype(np.float32)
    objective = objective_of(darkened, prediction, teapot, VISIBLE)
    gain = _gain(objective, objective, point, NOISE, 1e-6)
    assert gain is not None and np.abs((gain.factor - falling())[covered]).max() < 0.03
    assert gain.residual < 0.005
    certain = _gain(objective, objective, point, NOISE, 1e12)
    assert certain is not None and np.allclose(certain.factor, 1, atol=1e-4)
    assert certain.residual > 10 * gain.residual and certain.penalty < 0.1


def test_a_divided_photo_has_the_density_of_the_photo(studio, teapot: ObjectClass) -> None:
    """log p(c) = log N(c / g; mu, s) - 3 log g."""
    photo, truth, prediction = shaded(studio)
    objective = objective_of(photo, prediction, teapot, SETTINGS)
    point = objective.point(truth)
    half = _divide_by_gain(objective, np.full(photo.shape[:2], 0.5))
    expected = objective_of(2 * photo, prediction, teapot, SETTINGS).likelihood.observed
    assert_close(half.likelihood.observed, expected)
    difference = half.likelihood.log_prior - objective.likelihood.log_prior
    assert_close(difference[..., 0], np.full_like(difference[..., 0], -3 * math.log(0.5)))
    assert not difference[..., 1:].any()
    one = _divide_by_gain(objective, np.ones(photo.shape[:2]))
    assert one.evaluate_one(point, 0.03).value == objective.evaluate_one(point, 0.03).value


def test_where_nothing_is_visible_all_stays(studio, teapot: ObjectClass) -> None:
    photo, truth, prediction = shaded(studio)
    objective = objective_of(0.01 * photo, prediction, teapot, SETTINGS)
    begun = selected(objective.point(truth))
    divided, refined = with_shading_gain(objective, begun, SETTINGS)
    assert divided is objective and np.array_equal(refined.point, begun.point)


@dataclass(frozen=True)
class WithoutCurvature:
    """The default optimiser, which says nothing of the curvature and the path, as searches of first order."""

    def __call__(self, problem, starts, photo, sigma, budget) -> Descent:
        return replace(LevenbergMarquardt()(problem, starts, photo, sigma, budget), normal=None, path=None)


@pytest.mark.parametrize("optimizer", [LevenbergMarquardt(), WithoutCurvature()])
def test_evidence_counts_the_gain_and_curvature_is_under_the_photos_noise(
    optimizer, studio, teapot: ObjectClass
) -> None:
    photo, truth, prediction = shaded(studio, falling())
    # Strong texture, which no gain explains: more noise than the pixel model's.
    noise = np.float32(0.1) * np.random.default_rng(1).standard_normal(photo.shape, np.float32)
    settings = replace(SETTINGS, optimizer=optimizer)
    objective = objective_of((photo + noise).clip(0, 1), prediction, teapot, settings)
    point = objective.point(truth)
    divided, refined = with_shading_gain(objective, selected(point, -math.inf), settings)
    assert divided is not objective and refined.evidence is not None and refined.normal is not None
    without_prior = divided.evaluate_one(refined.point, settings.likelihood.sigma)
    assert refined.evidence < without_prior.value
    assert without_prior.normal is not None
    ratio = refined.normal.diagonal() / without_prior.normal[0].diagonal()
    assert np.median(ratio[:23]) < 0.8
    assert np.array_equal(refined.path[-1:], refined.point)
    # Where the guess has more evidence the search's own end stays.
    begun = selected(point, refined.evidence)
    divided, refined = with_shading_gain(objective, begun, settings)
    assert divided is objective and np.array_equal(refined.point, begun.point)


@pytest.mark.parametrize("factor", [0.01, 20.0])
def test_the_gain_keeps_its_bounds(factor: float, studio, teapot: ObjectClass) -> None:
    photo, truth, prediction = shaded(studio)
    objective = objective_of((factor * photo).clip(None, 8.0), prediction, teapot, VISIBLE)
    point = objective.point(truth)
    gain = _gain(objective, objective, point, NOISE, 1e-9)
    assert gain is not None and gain.factor.min() >= MIN_GAIN and gain.factor.max() <= MAX_GAIN
    assert _divide_by_gain(objective, gain.factor).likelihood.observed.max() <= BRIGHTEST


def test_photographs_frames_and_the_gaussian_model_are_without(studio, teapot: ObjectClass) -> None:
    assert PHOTO["gain_deviation"] == 0.0 and for_tracking(SETTINGS).gain_deviation == 0.0
    photo, _, prediction = shaded(studio, falling())
    paper = replace(SETTINGS, likelihood=GAUSSIAN)
    found = explain_one(photo, prediction, teapot, paper)
    plain = explain_one(photo, prediction, teapot, replace(paper, gain_deviation=0.0))
    assert np.array_equal(found.latents.to_vector(), plain.latents.to_vector())
