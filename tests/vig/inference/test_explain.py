"""A photo whose explanation is known, explained; and what the verdict says when it cannot be."""

import json
import math
import shutil
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from tests.support import assert_close
from tests.vig.recognition.predictions import prediction_of, prediction_of_latents, view_probabilities
from vig.inference import (
    CONFIDENCE_FEATURES,
    ExplainSettings,
    Fit,
    FitCalibration,
    Objective,
    Verdict,
    explain,
    explain_one,
    resolve,
)
from vig.inference.calibration import MIN_DEVIATION, UNCALIBRATED_WIDENING
from vig.inference.confidence import MAX_GAP, _mixture_deviation, make_fit
from vig.inference.posterior import objective_of, objectives_of, pixel_prior, prior_of
from vig.inference.refinement import RefinedStarts, select
from vig.inference.settings import PICTURE, Stage
from vig.io.errors import UserError
from vig.likelihood import GAUSSIAN, ROBUST, SPATIAL, PixelModel, log_colour_density
from vig.likelihood.geometry import Geometry
from vig.recognition import Prediction
from vig.recognition.prediction import START_STEP, round_to_grid
from vig.scene import Latents, ObjectClass, latent_layout
from vig.search.optimizer import Budget, Descent

SETTINGS = ExplainSettings(
    **PICTURE | {"decoration": 0.0, "prior_weight": 100.0, "gain_deviation": 0.0},
    self_shadow=False,
    calibrated=False,
    azimuth_weight=0.0,
)
"""The studio's photos have no self-shadow and no decoration, and its predictions are made by hand."""

THOROUGH = replace(
    SETTINGS,
    stages=(
        Stage(16, 8, sigma=4.0, scale=0.5, tolerance=20.0),
        Stage(6, 10, sigma=4.0, scale=0.5, tolerance=5.0),
        Stage(4, 12, sigma=2.0, tolerance=5.0),
        Stage(3, 30, tolerance=0.5),
    ),
    prior_weight=1.0,
)
"""For predictions farther off than a network's: more starts, and evidence against an unweighed prior."""


@dataclass(frozen=True)
class Case:
    """A photo (H, W, 3), its truth, and a prediction 8 degrees off in azimuth."""

    photo: np.ndarray
    truth: Latents
    prediction: Prediction
    amodal: np.ndarray


def case(studio, seed: int, occluded: bool, off_deg: float = 8.0) -> Case:
    rng = np.random.default_rng(seed)
    truth = studio.latents(rng)
    _, coverage, colour = studio.render(truth)
    photo = studio.photo(rng, truth, occluded=occluded, noise=0.01)[0].astype(np.float32)
    amodal = coverage[0] > 0.5
    seen = amodal & (np.abs(photo - colour[0]).max(-1) < 0.06)
    shares = np.stack([seen, amodal & ~seen, ~amodal], axis=-1).astype(np.float32)
    return Case(photo, truth, prediction_of_latents(truth, 0.7 * shares + 0.1, off_deg), amodal)


@pytest.fixture(scope="module")
def whole(studio) -> Case:
    return case(studio, 1, occluded=False)


@pytest.fixture(scope="module")
def occluded(studio) -> Case:
    return case(studio, 2, occluded=True)


def azimuth_off(found: Latents, truth: Latents) -> float:
    turn = (found.azimuth[0] - truth.azimuth[0] + math.pi) % (2 * math.pi) - math.pi
    return abs(math.degrees(turn))


@dataclass(frozen=True)
class Answers:
    """An optimiser that ends where it is told: points (B, P') built from an objective and the starts."""

    points: Callable[[Objective, np.ndarray], np.ndarray]

    def __call__(
        self, objective: Objective, starts: np.ndarray, photo: np.ndarray, sigma: float, budget: Budget
    ) -> Descent:
        ends = self.points(objective, starts)
        value, once = evidence_of(objective, ends, sigma), np.ones(len(ends), np.int64)
        return Descent(ends, value, once, once > 0)


def evidence_of(objective: Objective, points: np.ndarray, sigma: float) -> np.ndarray:
    """Log posterior (B,) of points (B, P')."""
    count = len(points)
    return objective(points, np.zeros(count, np.int32), np.full(count, sigma), derivatives=False).value


def joined(*parts: Latents) -> Latents:
    return Latents.from_vector(np.concatenate([part.to_vector() for part in parts]))


def turned(latents: Latents, degrees: float) -> Latents:
    return replace(latents, azimuth=latents.azimuth + math.radians(degrees))


def ending_at(*ends: Latents) -> ExplainSettings:
    """Settings under which every search ends at the same points."""
    optimizer = Answers(lambda objective, starts: objective.point(joined(*ends)))
    return replace(SETTINGS, stages=(Stage(len(ends), 1),), optimizer=optimizer)


@pytest.mark.parametrize("name", ["whole", "occluded"])
def test_a_known_photo_is_explained(name: str, request, teapot: ObjectClass) -> None:
    given: Case = request.getfixturevalue(name)
    assert azimuth_off(given.prediction.best(), given.truth) == pytest.approx(8.0, abs=0.5)
    found = explain_one(given.photo, given.prediction, teapot, THOROUGH)
    assert found.verdict is Verdict.TRUSTED and not found.alternatives
    assert azimuth_off(found.latents, given.truth) < 0.5
    assert np.array_equal(
        found.descent[-1:], np.concatenate([found.latents.to_vector(), found.framing[None]], axis=1)
    )
    assert azimuth_off(Latents.from_vector(found.descent[:1, : latent_layout(10).size]), given.truth) > 1.0, (
        "where it began"
    )
    assert np.degrees(np.abs(found.latents.elevation - given.truth.elevation)) < 1.0
    # Brightness trades with the light, which the hand-made prediction knows little of; hue does not.
    ratio = found.latents.albedo / given.truth.albedo
    assert_close(ratio, np.ones((1, 3)), atol=0.15, rtol=0)
    assert_close(ratio / ratio.mean(), np.ones((1, 3)), atol=0.02, rtol=0)
    assert found.evidence > found.start_evidence + 100
    hits = (found.amodal & given.amodal).sum() / (found.amodal | given.amodal).sum()
    assert hits > 0.95
    assert not (found.mask & ~found.amodal).any()
    assert found.deviation.shape == (24,) and (found.deviation > 0).all()
    assert math.degrees(found.deviation[10]) < 2.5
    assert found.evaluations > sum(stage.starts for stage in THOROUGH.stages)


def test_what_is_hidden_is_left_out_of_the_mask(occluded: Case, teapot: ObjectClass) -> None:
    found = explain_one(occluded.photo, occluded.prediction, teapot, SETTINGS)
    seen = occluded.prediction.mask[0, ..., 0] > 0.5
    assert occluded.amodal.sum() > 1.15 * seen.sum()  # something is hidden at all
    assert (found.mask & seen).sum() / (found.mask | seen).sum() > 0.9
    assert ((found.visible >= 0) & (found.visible <= 1)).all()


def test_the_spatial_model_has_a_mask_of_its_own_for_the_same_fit(
    occluded: Case, teapot: ObjectClass
) -> None:
    robust, spatial = (
        explain_one(occluded.photo, occluded.prediction, teapot, replace(SETTINGS, likelihood=likelihood))
        for likelihood in (replace(ROBUST, alpha=SPATIAL.alpha), SPATIAL)
    )
    assert np.array_equal(robust.latents.to_vector(), spatial.latents.to_vector())
    assert robust.evidence == spatial.evidence and np.array_equal(robust.amodal, spatial.amodal)
    assert not np.array_equal(robust.visible, spatial.visible)
    seen = occluded.prediction.mask[0, ..., 0] > 0.5
    assert (spatial.mask & seen).sum() / (spatial.mask | seen).sum() > 0.95
    assert not (spatial.mask & ~spatial.amodal).any()


def test_outline_and_mask_are_joined_with_the_networks_by_its_share(whole: Case, teapot: ObjectClass) -> None:
    """The network is sure of a square beside the object, and of nothing else."""
    mask = np.full((1, *whole.photo.shape[:2], 3), 1 / 3, np.float32)
    mask[0, :20, :20] = 0.98, 0.01, 0.01
    prediction = replace(whole.prediction, mask=mask)
    square = np.zeros(whole.photo.shape[:2], bool)
    square[:20, :20] = True

    def found(share: float, likelihood: PixelModel = SPATIAL) -> Fit:
        settings = replace(SETTINGS, network_mask_share=share, likelihood=likelihood)
        return explain_one(whole.photo, prediction, teapot, settings)

    alone, joined = found(0.0), found(0.7)
    assert not (alone.amodal & square).any() and (joined.amodal & joined.mask)[square].all()
    assert np.allclose(joined.coverage, 0.3 * alone.coverage + 0.7 * (1 - mask[0, ..., 2]), atol=1e-6)
    assert np.array_equal(joined.confidence_features, alone.confidence_features)
    assert not (found(0.7, GAUSSIAN).amodal & square).any(), "a model without occluders has none"


def test_explain_asks_the_recognizer_and_explains_each_photo(
    whole: Case, occluded: Case, teapot: ObjectClass
) -> None:
    photos = np.stack([whole.photo, occluded.photo])
    both = Prediction.concatenate([whole.prediction, occluded.prediction])
    asked = []

    def recognizer(given: np.ndarray) -> Prediction:
        asked.append(given)
        return both

    quick = replace(SETTINGS, stages=(Stage(2, 3),))
    first, second = explain(photos, teapot, recognizer, quick)
    assert len(asked) == 1 and np.array_equal(asked[0], photos)
    assert first.evidence == explain_one(whole.photo, whole.prediction, teapot, quick).evidence
    assert second.evidence == explain_one(occluded.photo, occluded.prediction, teapot, quick).evidence


def test_ends_below_the_guess_are_not_taken(whole: Case, teapot: ObjectClass) -> None:
    found = explain_one(whole.photo, whole.prediction, teapot, ending_at(turned(whole.truth, 25)))
    assert found.verdict is Verdict.REVERTED and found.reason == Verdict.REVERTED.value
    guess = round_to_grid(whole.prediction.round_for_search().best().to_vector(), START_STEP)
    assert_close(found.latents.to_vector(), guess)
    assert found.evidence == pytest.approx(found.start_evidence)
    assert not found.alternatives


LOGIT_OF_90 = math.log(0.9 / 0.1)
"""The log odds at which `saying` becomes as confident as it asks for."""


@pytest.mark.parametrize(
    ("bias", "verdict"),
    [
        (8.0, Verdict.TRUSTED),
        (LOGIT_OF_90 + 0.02, Verdict.TRUSTED),  # a confidence of 0.902
        (LOGIT_OF_90 - 0.02, Verdict.AMBIGUOUS),  # 0.898
        (-8.0, Verdict.AMBIGUOUS),
    ],
)
def test_a_calibration_decides_the_verdict_and_widens_deviations(
    bias: float, verdict: Verdict, whole: Case, teapot: ObjectClass
) -> None:
    scale = np.stack([np.linspace(1000, 2000, 24), np.linspace(3000, 4000, 24)])
    said = saying(bias, 20.0, scale)
    plain = explain_one(whole.photo, whole.prediction, teapot, ending_at(whole.truth))
    assert math.isnan(plain.confidence)
    given = replace(ending_at(whole.truth), calibrated=True, calibration=said)
    found = explain_one(whole.photo, whole.prediction, teapot, given)
    assert found.verdict is verdict and found.confidence == pytest.approx(1 / (1 + math.exp(-bias)))
    residual = np.exp(found.confidence_features[CONFIDENCE_FEATURES.index("log_residual")])
    assert 0.005 < residual < 0.02, "the photo's noise is 0.01"
    row = 0 if verdict is Verdict.TRUSTED else 1
    evidence = plain.deviation / UNCALIBRATED_WIDENING
    expected = residual * scale[row] * evidence
    assert (expected > 2 * MIN_DEVIATION).all(), "or every factor would do"
    azimuth, other = latent_layout(10).at("azimuth"), np.arange(24) != latent_layout(10).at("azimuth")
    assert_close(found.deviation[other], expected[other])
    if verdict is Verdict.TRUSTED:
        assert_close(found.deviation[azimuth], expected[azimuth])
    else:
        about_view = residual * scale[0, azimuth] * evidence[azimuth]
        spread = _mixture_deviation(about_view, found.confidence, whole.prediction, found.latents.azimuth)
        assert found.deviation[azimuth] == pytest.approx(spread)
    flat = replace(given, likelihood=GAUSSIAN)  # of which nothing was learned
    assert math.isnan(explain_one(whole.photo, whole.prediction, teapot, flat).confidence)


def test_a_calibration_of_another_density_judges_nothing(
    whole: Case, teapot: ObjectClass, tmp_path: Path
) -> None:
    assert teapot.folder is not None
    pack = shutil.copytree(teapot.folder, tmp_path / "pack")
    file = pack / "calibration.json"
    settings = replace(ending_at(whole.truth), calibrated=True)
    found = []
    for density in ("gaussian", "cauchy"):
        replace(saying(8.0, 20.0), density=density).save(file)
        assert FitCalibration.load(file).density == density
        found.append(explain_one(whole.photo, whole.prediction, ObjectClass.load(pack), settings))
    without = explain_one(whole.photo, whole.prediction, teapot, replace(settings, calibrated=False))
    assert found[0].confidence > 0.9 and found[0].view_threshold == 0.9
    assert math.isnan(found[1].confidence) and math.isnan(found[1].view_threshold)
    assert found[1].verdict is without.verdict and found[1].reason == without.reason
    assert_close(found[1].deviation, without.deviation)
    # One that says nothing is of the default density.
    text = json.loads(file.read_text())
    file.write_text(json.dumps({name: value for name, value in text.items() if name != "density"}))
    assert FitCalibration.load(file).density == "gaussian"
    other = replace(saying(8.0, 20.0), density="cauchy")
    with pytest.raises(ValueError, match="of fits with density 'gaussian'; got one of 'cauchy'"):
        replace(settings, calibration=other)


def test_deviations_are_widened_by_scale_floor_and_residual() -> None:
    """A residual of 1/2: sqrt((30 x 0.1)^2 + 4^2) / 2 = 2.5 where trusted, else
    sqrt((50 x 0.1)^2 + 12^2) / 2 = 6.5.
    """
    features = np.zeros(len(CONFIDENCE_FEATURES))
    features[CONFIDENCE_FEATURES.index("log_residual")] = math.log(0.5)
    scale, floor = np.array([[30.0, 1.0], [50.0, 1.0]]), np.array([[4.0, 0.0], [12.0, 0.0]])
    said = replace(saying(0.0, 0.0, scale), floor=floor)
    deviation = np.array([0.1, 1e-6])
    assert said.widen_deviations(deviation, features, True).tolist() == pytest.approx([2.5, MIN_DEVIATION])
    assert said.widen_deviations(deviation, features, False).tolist() == pytest.approx([6.5, MIN_DEVIATION])


def test_deviations_are_those_of_all_numbers_together(whole: Case, teapot: ObjectClass) -> None:
    """Of the inverse of the whole normal matrix: shape and albedo trade off against light and pose."""
    found = explain_one(whole.photo, whole.prediction, teapot, ending_at(whole.truth))
    objective = objective_of(whole.photo, whole.prediction.round_for_search(), teapot, SETTINGS)
    normal = objective.evaluate_one(objective.point(whole.truth), SETTINGS.likelihood.sigma).normal
    size = len(found.deviation)
    matrix = normal[0, :size, :size].astype(np.float64)  # the framing is held
    expected = UNCALIBRATED_WIDENING * np.sqrt(np.linalg.inv(matrix).diagonal())
    assert_close(found.deviation, expected, rtol=1e-3, atol=0)
    diagonal_alone = UNCALIBRATED_WIDENING / np.sqrt(matrix.diagonal())
    assert (expected > 2 * diagonal_alone).any(), "or the diagonal would do"


@pytest.mark.parametrize(("in_distribution_bias", "unlike"), [(-0.05, True), (0.05, False)])
def test_a_photo_is_of_an_unknown_kind_from_one_half_on(
    in_distribution_bias: float, unlike: bool, whole: Case, teapot: ObjectClass
) -> None:
    said = saying(0.0, in_distribution_bias)
    given = replace(ending_at(whole.truth), calibrated=True, calibration=said)
    found = explain_one(whole.photo, whole.prediction, teapot, given)
    known = 1 / (1 + math.exp(-in_distribution_bias))
    assert found.confidence == pytest.approx(0.5 * min(1, 2 * known))
    assert not found.mask_trusted
    assert found.verdict is Verdict.AMBIGUOUS and ("unlike those" in found.reason) == unlike


def judged(case: Case, teapot: ObjectClass, turned_deg: float, gap: float) -> Fit:
    """The truth, and beside it a view turned by so much whose score is so many nats less."""
    objective = objective_of(case.photo, case.prediction, teapot, SETTINGS)
    points = objective.point(joined(case.truth, turned(case.truth, turned_deg)))
    sigma = SETTINGS.likelihood.sigma
    values = evidence_of(objective, points, sigma)
    ends = RefinedStarts(points, values, np.array([1000.0, 1000.0 - gap]), 1, points[:0], points[None])
    selection = select(objective, ends, case.prediction.best(), sigma)
    return make_fit(objective, selection, case.prediction, SETTINGS, None)


@pytest.mark.parametrize(
    ("turned_deg", "gap", "verdict"),
    [
        (60, 29, Verdict.AMBIGUOUS),
        (60, 31, Verdict.TRUSTED),
        (26, 1, Verdict.AMBIGUOUS),
        (-26, 1, Verdict.AMBIGUOUS),
        (24, 1, Verdict.TRUSTED),
    ],
)
def test_another_view_is_one_more_than_25_degrees_away_and_near_is_within_30_nats(
    turned_deg: float, gap: float, verdict: Verdict, whole: Case, teapot: ObjectClass
) -> None:
    found = judged(whole, teapot, turned_deg, gap)
    assert found.verdict is verdict
    if verdict is Verdict.AMBIGUOUS:
        assert found.reason == f"turned by {abs(turned_deg)} degrees it fits nearly as well ({gap} nats less)"
        assert azimuth_off(found.alternatives[0].latents, turned(whole.truth, turned_deg)) < 1e-3
    assert azimuth_off(found.latents, whole.truth) < 1e-3
    lead = math.log1p(gap) if abs(turned_deg) > 25 else math.log1p(MAX_GAP)  # no other view at all
    assert found.confidence_features[CONFIDENCE_FEATURES.index("evidence_gap")] == pytest.approx(lead)


def test_confidence_features_are_what_their_names_say(occluded: Case, teapot: ObjectClass) -> None:
    layout, deviation = occluded.prediction.layout, np.linspace(0.1, 0.9, 23, dtype=np.float32)[None]
    deviation[0, layout["elevation"]] = 0.2
    prediction = replace(occluded.prediction, deviation=deviation)
    found = explain_one(occluded.photo, prediction, teapot, SETTINGS)
    feature = dict(zip(CONFIDENCE_FEATURES, found.confidence_features.tolist(), strict=True))
    seen, whole = int(found.mask.sum()), int(found.amodal.sum())
    assert 0 < seen < 0.9 * whole
    assert feature["hidden_fraction"] == pytest.approx(1 - seen / whole)
    assert feature["log_visible_pixels"] == pytest.approx(math.log(1 + seen))
    assert feature["sine_elevation"] == pytest.approx(math.sin(found.latents.elevation[0]))
    assert feature["view_log_probability"] == pytest.approx(prediction.log_mass(found.latents.azimuth)[0])
    assert feature["network_agrees"] == 1  # 8 degrees off at most
    assert feature["log_elevation_deviation"] == pytest.approx(math.log(0.2))
    assert feature["shape_deviation"] == pytest.approx(deviation[0, layout["shape"]].mean())
    chances = [chance for chance in prediction.azimuth[0].tolist() if chance > 0]
    assert feature["log_azimuth_entropy"] == pytest.approx(
        math.log(-sum(p * math.log(p) for p in chances)), rel=1e-3
    )
    at_truth = explain_one(occluded.photo, prediction, teapot, ending_at(occluded.truth)).confidence_features
    residual = at_truth[CONFIDENCE_FEATURES.index("log_residual")]
    assert residual == pytest.approx(math.log(0.01), abs=0.05), "the photo's noise"
    assert residual < feature["log_residual"] < residual + 0.7
    told = []
    for mask, amodal, said in zip(
        found.mask.flat, found.amodal.flat, prediction.mask[0].reshape(-1, 3).tolist(), strict=True
    ):
        if mask:
            told.append(said[0])  # visible
        elif amodal:
            told.append(said[1])  # hidden
        elif said[0] > 0.3:
            told.append(1 - said[0])  # the network sees what the fit does not cover
    assert feature["mask_log_probability"] == pytest.approx(sum(map(math.log, told)) / len(told), rel=1e-4)


def test_the_rival_is_the_most_probable_other_view(whole: Case, teapot: ObjectClass) -> None:
    """Of 72 bins the fit's has .6 of the probability, one 30 degrees away .25, one half a turn away .15."""
    there = int(whole.truth.azimuth[0] / math.radians(5)) % 72
    probability = np.zeros((1, 72), np.float32)
    for turn_deg, share in ((0, 0.6), (30, 0.25), (180, 0.15)):
        probability[0, (there + turn_deg // 5) % 72] = share
    for prediction, expected in (
        (replace(whole.prediction, azimuth=probability), 0.15),
        (replace(whole.prediction, azimuth=np.eye(72, dtype=np.float32)[[there]]), 1e-3),
    ):
        found = explain_one(whole.photo, prediction, teapot, ending_at(whole.truth))
        feature = dict(zip(CONFIDENCE_FEATURES, found.confidence_features.tolist(), strict=True))
        assert feature["rival_log_probability"] == pytest.approx(math.log(expected), rel=1e-4)


@pytest.mark.parametrize("share", [0.95, 1.05])
def test_the_networks_word_on_the_view_counts_by_its_weight(
    share: float, whole: Case, teapot: ObjectClass
) -> None:
    """Two ends 20 degrees apart: evidence speaks for the first, the network for the second.

    The second wins from a weight on at which the log probabilities make up for the evidence.
    """
    other = turned(whole.truth, 20)
    prediction = replace(whole.prediction, azimuth=view_probabilities(other.azimuth[0], 1.0))
    ends, given = joined(whole.truth, other), ending_at(whole.truth, other)
    objective = objective_of(whole.photo, prediction, teapot, given)
    evidence = evidence_of(objective, objective.point(ends), given.likelihood.sigma)
    support = prediction.log_mass(ends.azimuth)
    even = (evidence[0] - evidence[1]) / (support[1] - support[0])
    assert even > 100
    found = explain_one(whole.photo, prediction, teapot, replace(given, view_weight=share * even))
    assert azimuth_off(found.latents, whole.truth if share < 1 else other) < 1


def test_stages_are_run_at_their_scale_noise_and_budget(whole: Case, teapot: ObjectClass) -> None:
    asked = []

    def still(
        objective: Objective, starts: np.ndarray, photo: np.ndarray, sigma: float, budget: Budget
    ) -> Descent:
        asked.append((objective.likelihood.camera.height, len(starts), sigma, budget))
        return Answers(lambda _, ends: ends)(objective, starts, photo, sigma, budget)

    stages = (Stage(6, 5, sigma=4.0, scale=0.5, tolerance=40.0), Stage(3, 7, sigma=2.0), Stage(2, 9))
    found = explain_one(
        whole.photo, whole.prediction, teapot, replace(SETTINGS, stages=stages, optimizer=still)
    )
    assert asked == [
        (75, 6, 4 * 0.03, Budget(5, 40.0, curvature=False)),
        (150, 3, 2 * 0.03, Budget(7, 0.5, curvature=False)),
        (150, 2, 0.03, Budget(9, 0.5)),
    ]
    assert found.evaluations == 6 + 3 + 2


def test_a_photo_with_self_shadow_is_explained_with_self_shadow(
    whole: Case, studio, teapot: ObjectClass
) -> None:
    """Of photos with and without, each has the greater evidence under its own renderer, by far."""
    assert teapot.transfer is not None
    shadowed = Geometry(teapot.shape_model, np.float64, teapot.transfer)
    for shadow, photographer in ((False, studio), (True, replace(studio, geometry=shadowed))):
        _, coverage, colour = photographer.render(whole.truth)
        photo = np.where(coverage[0, ..., None] > 0.5, colour[0], 0.5).astype(np.float32)
        evidence = {}
        for assumed in (False, True):
            given = replace(ending_at(whole.truth), self_shadow=assumed)
            evidence[assumed] = explain_one(photo, whole.prediction, teapot, given).evidence
        assert evidence[shadow] > evidence[not shadow] + 300


def test_what_is_covered_is_covered_by_half_or_more(whole: Case, studio, teapot: ObjectClass) -> None:
    found = explain_one(whole.photo, whole.prediction, teapot, ending_at(whole.truth))
    coverage = studio.render(whole.truth)[1][0]
    assert ((coverage > 0.1) & (coverage < 0.4)).sum() > 20, "or any threshold would do"
    assert not found.amodal[coverage < 0.4].any() and found.amodal[coverage > 0.6].all()


def test_the_mask_is_what_is_more_likely_seen_than_not(occluded: Case, teapot: ObjectClass) -> None:
    found = explain_one(occluded.photo, occluded.prediction, teapot, replace(SETTINGS, likelihood=ROBUST))
    assert np.array_equal(found.mask, found.visible > 0.5)
    assert np.array_equal(found.mask, found.mask_by_pixel)  # neighbours are not asked
    doubtful = (found.visible > 0.2) & (found.visible < 0.5)
    assert doubtful.sum() > 20 and not (found.mask & doubtful).any()


@pytest.mark.parametrize(("off", "seen"), [(0.27, True), (0.32, False)])
def test_a_pixel_is_seen_up_to_three_deviations_of_a_tenth(
    off: float, seen: bool, whole: Case, studio, teapot: ObjectClass
) -> None:
    """Seen and hidden are as likely where log(0.55 / 0.45) - r^2 / (2 0.1^2) - 3 log(0.1 sqrt(2 pi)) = 0:
    at a residual r of 0.295, however small the noise of the fit.
    """
    given = replace(ending_at(whole.truth), likelihood=ROBUST, mask_weight=0.0, surroundings=0.0)
    _, coverage, colour = studio.render(whole.truth)
    photo = colour[0].astype(np.float32) + off / math.sqrt(3)
    found = explain_one(photo, prediction_of_latents(whole.truth, whole.prediction.mask[0]), teapot, given)
    inside = coverage[0] > 0.99
    assert found.mask[inside].mean() == pytest.approx(float(seen), abs=0.02)


def test_a_users_setting_comes_before_the_classes_and_that_before_the_kind_of_photos(
    teapot: ObjectClass, tmp_path: Path
) -> None:
    """A class states its own in one line of class.json, without any code that knows of it."""
    teapot.save(tmp_path)
    description = json.loads((tmp_path / "class.json").read_text())
    (tmp_path / "class.json").write_text(json.dumps(description | {"fit_settings": {"prior_weight": 30.0}}))
    own = ObjectClass.load(tmp_path)
    assert resolve(ExplainSettings(), teapot, photo=True).prior_weight == 20.0
    assert resolve(ExplainSettings(), own, photo=True).prior_weight == 30.0
    assert resolve(ExplainSettings(prior_weight=0.0), own, photo=True).prior_weight == 0.0
    assert (
        resolve(
            ExplainSettings(decoration=0.0, camera_distance_ratio=2.0), own, photo=True
        ).camera_distance_ratio
        == 2.0
    )
    resolved = resolve(ExplainSettings(view_weight=7.0), own)
    assert resolve(resolved, teapot, photo=True) is resolved
    own.save(tmp_path / "again")
    assert ObjectClass.load(tmp_path / "again").fit_settings == {"prior_weight": 30.0}


@pytest.mark.parametrize(
    "stated, why",
    [
        ({"prior_wieght": 30.0}, "among free_framing, .*; got 'prior_wieght'. Correct its class.json"),
        ({"prior_weight": -1.0}, "settings of class 'teapot': prior_weight must be from 0 to inf; got -1.0"),
        (
            {"camera_distance_ratio": 0.0},
            "settings of class 'teapot': camera_distance_ratio must be a ratio above 0; got 0.0",
        ),
        (
            {"free_framing": 1.0},
            "expected true or false as fit setting 'free_framing' of class '.*'; got 1.0",
        ),
        ({"prior_weight": True}, "expected a number as fit setting 'prior_weight' of class '.*'; got True"),
    ],
)
def test_a_class_whose_settings_are_none_is_refused(
    stated: dict[str, float], why: str, teapot: ObjectClass
) -> None:
    with pytest.raises(UserError, match=why):
        resolve(ExplainSettings(), replace(teapot, fit_settings=stated))


def saying(bias: float, in_distribution_bias: float, scale: np.ndarray | None = None) -> FitCalibration:
    """What says the same of every fit."""
    nothing, floor = np.zeros(len(CONFIDENCE_FEATURES)), np.zeros((2, 24))
    factors = np.ones((2, 24)) if scale is None else scale
    of_view, of_kind, of_mask = (nothing, bias), (nothing, in_distribution_bias), (nothing, bias - 1.0)
    return FitCalibration(*of_view, *of_kind, *of_mask, 0.9, 0.9, factors, floor)


@pytest.mark.parametrize(
    ("bias", "trusted"), [(3.1, (True, False)), (3.3, (True, True)), (2.1, (False, False))]
)
def test_a_view_may_be_trusted_while_the_mask_is_not(
    bias: float, trusted: tuple[bool, bool], whole: Case, teapot: ObjectClass
) -> None:
    """The mask's log odds are one below the view's, and both need .9, log odds of 2.2."""
    said = saying(bias, 9.0)
    settings = replace(ending_at(whole.truth), calibrated=True, calibration=said)
    found = explain_one(whole.photo, whole.prediction, teapot, settings)
    assert (found.verdict is Verdict.TRUSTED, found.mask_trusted) == trusted
    assert found.mask_confidence == pytest.approx(1 / (1 + math.exp(1 - bias)))


def test_nothing_to_be_seen_is_a_failure(whole: Case, teapot: ObjectClass) -> None:
    """Blue noise throughout: a red teapot explains no pixel of it."""
    photo = np.zeros((150, 150, 3), np.float32)
    photo[..., 2] = np.random.default_rng(3).uniform(0.8, 1.0, (150, 150))
    red = replace(whole.truth, albedo=np.array([[0.9, 0.1, 0.0]]))
    prediction = prediction_of_latents(red, np.full((150, 150, 3), 1 / 3, np.float32))
    found = explain_one(photo, prediction, teapot, replace(SETTINGS, stages=(Stage(4, 0),)))
    assert found.verdict is Verdict.FAILED and found.reason == Verdict.FAILED.value
    assert not found.mask.any() and not found.alternatives
    assert np.isfinite(found.deviation).all()


def test_what_was_not_photographed_counts_for_nothing(whole: Case, teapot: ObjectClass) -> None:
    known = np.ones((150, 150), bool)
    known[:, :60] = False
    other = whole.photo.copy()
    other[:, :60] = np.random.default_rng(5).uniform(0, 1, (150, 60, 3))
    first, second = (
        explain_one(photo, whole.prediction, teapot, SETTINGS, known) for photo in (whole.photo, other)
    )
    assert first.evidence == second.evidence
    assert np.array_equal(first.latents.to_vector(), second.latents.to_vector())
    assert not first.mask[:, :60].any() and not second.mask[:, :60].any()
    everything = np.ones((150, 150), bool)
    assert (
        explain_one(whole.photo, whole.prediction, teapot, SETTINGS, everything).evidence
        == explain_one(whole.photo, whole.prediction, teapot, SETTINGS).evidence
    )


def test_free_framing_explains_shifted_teapots_better(studio, teapot: ObjectClass) -> None:
    gains = []
    for seed in range(2):
        rng = np.random.default_rng(seed)
        truth = studio.latents(rng)
        framing = np.array([[0.06, -0.04, 0.0, 0.03]])  # magnification mixes with size
        photo = studio.photo(rng, truth, framing, occluded=False, noise=0.01)[0].astype(np.float32)
        prediction = prediction_of_latents(truth, np.full((150, 150, 3), 1 / 3, np.float32), 4.0)
        found = explain_one(photo, prediction, teapot, replace(SETTINGS, free_framing=True))
        assert found.framing.any()
        assert found.deviation.shape == (24,)
        held = explain_one(photo, prediction, teapot, SETTINGS)
        assert not held.framing.any()
        gains.append(found.evidence - held.evidence)
    assert min(gains) > 300


def test_without_mask_surroundings_and_decoration_the_prior_is_the_papers(whole: Case) -> None:
    plain = replace(SETTINGS, mask_weight=0.0, surroundings=0.0, decoration=0.0)
    prior, decorated = pixel_prior(whole.photo, whole.prediction.mask[0], plain)
    assert_close(prior, ROBUST.log_prior(150, 150))
    assert not decorated.any()


def test_mask_weight_takes_the_predicted_mask_that_far(whole: Case) -> None:
    mask = np.full((150, 150, 3), 0.3, np.float32)
    mask[:10] = 1.0, 0.0, 0.0
    for weight in (0.5, 1.0):
        given = replace(SETTINGS, mask_weight=weight, surroundings=0.0, decoration=0.0)
        said = pixel_prior(whole.photo, mask, given)[0] - ROBUST.log_prior(150, 150)
        assert_close(said[20:], np.full((130, 150, 3), weight * math.log(0.3)))
        sure = weight * np.log([1.0, 0.02, 0.02])  # 2 % for the impossible
        assert_close(said[:10], np.broadcast_to(sure, (10, 150, 3)))


def test_surroundings_replace_the_uniform_density_of_what_is_not_the_object(whole: Case) -> None:
    mask = whole.prediction.mask[0]
    density = log_colour_density(whole.photo, 1 - mask[..., 0])
    for share in (0.5, 1.0):
        given = replace(SETTINGS, mask_weight=0.0, surroundings=share, decoration=0.0)
        said = pixel_prior(whole.photo, mask, given)[0] - ROBUST.log_prior(150, 150)
        expected = np.stack([np.zeros_like(density), share * density, share * density], axis=-1)
        assert_close(said, expected)


def test_decoration_shares_a_visible_pixel_between_the_rendered_and_the_objects_other_colours(
    whole: Case,
) -> None:
    """alpha (1 - d) N + alpha d own + (1 - alpha) U, the last two of which no latent changes."""
    mask, d, alpha = whole.prediction.mask[0], 0.25, ROBUST.alpha
    given = replace(SETTINGS, likelihood=ROBUST, mask_weight=0.0, surroundings=0.0, decoration=d)
    prior, decorated = pixel_prior(whole.photo, mask, given)
    own = alpha * d * np.exp(log_colour_density(whole.photo, mask[..., 0]))
    assert_close(np.exp(prior[..., 0]), np.full_like(own, alpha * (1 - d)))
    assert_close(np.exp(prior[..., 1]), own + 1 - alpha)
    assert_close(decorated, own / (own + 1 - alpha))
    assert not prior[..., 2].any(), "the background stays as it is"


def test_recognition_weight_scales_the_predicted_gaussians(whole: Case, teapot: ObjectClass) -> None:
    assert prior_of(whole.prediction, replace(SETTINGS, recognition_weight=0.0), teapot) is None
    weight = 0.5
    predicted_prior = prior_of(whole.prediction, replace(SETTINGS, recognition_weight=weight), teapot)
    best = whole.prediction.best().to_vector()[0]
    said = [*range(10), 11, 12, 13, 14]
    assert_close(predicted_prior.mean[said], best[said])
    assert_close(predicted_prior.precision[said], np.full(14, weight / 0.3**2, np.float32))
    assert predicted_prior.precision[10] == 0  # azimuth has peaks, not one Gaussian
    assert predicted_prior.azimuths[0] == pytest.approx(best[10], abs=1e-3)
    assert predicted_prior.azimuth_precision == pytest.approx(SETTINGS.azimuth_weight / math.radians(8) ** 2)
    plain, believing = (
        objective_of(
            whole.photo, whole.prediction, teapot, replace(SETTINGS, recognition_weight=w, prior_weight=7.0)
        )
        for w in (0.0, weight)
    )
    here = plain.point(whole.prediction.best())
    there = here.copy()
    there[:, 11] += 0.3
    drop = (believing.prior.value(here) - believing.prior.value(there)) - (
        plain.prior.value(here) - plain.prior.value(there)
    )
    # One deviation off costs half a nat, and the prior is raised to a power.
    assert drop == pytest.approx(7.0 * 0.5 * weight, abs=7e-3)


def test_a_smaller_photo_holds_the_same_information_per_cell(whole: Case, teapot: ObjectClass) -> None:
    half = objectives_of(whole.photo, whole.prediction, teapot, SETTINGS, (0.5,))[0.5]
    coverage = half.evaluate_one(half.point(whole.truth), 0.1, derivatives=False).coverage[0]
    assert coverage.shape == (75, 75)
    cells = whole.amodal.reshape(75, 2, 75, 2).mean((1, 3))
    assert np.abs(coverage - cells).mean() < 0.01


def test_a_fit_of_another_view_than_the_recognition_models_is_not_trusted(
    whole: Case, teapot: ObjectClass
) -> None:
    right, wrong = (view_probabilities(turned(whole.truth, off).azimuth[0]) for off in (0, 90))
    prediction = replace(whole.prediction, azimuth=0.4 * right + 0.6 * wrong)
    found = explain_one(whole.photo, prediction, teapot, SETTINGS)
    assert azimuth_off(found.latents, whole.truth) < 0.5  # the evidence overrules the network
    assert found.verdict is Verdict.AMBIGUOUS
    assert found.reason == "the recognition model sees it turned by 90 degrees"
    assert azimuth_off(found.alternatives[0].latents, whole.truth) == pytest.approx(90, abs=2)


@pytest.mark.parametrize(
    ("confidence", "peak_deg", "expected_deg"),
    [
        (0.95, 180, 5.0 * 1.94 / 1.645),  # nine tenths of all are 94.7 % of the Gaussian
        (0.5, 90, 90 / 1.645),
        (0.0, 140, 140 / 1.645),
        (0.0, None, (25 + 0.9 * 155) / 1.645),  # the view itself is taken out
    ],
)
def test_a_doubtful_azimuth_is_as_wide_as_its_views(
    confidence: float, peak_deg: float | None, expected_deg: float
) -> None:
    azimuth = np.full((1, 72), 1 / 72, np.float32)
    if peak_deg is not None:
        azimuth = np.zeros((1, 72), np.float32)
        azimuth[0, int((350 + peak_deg) % 360 / 5)] = 1.0
    prediction = prediction_of(azimuth, np.zeros((1, 0), np.float32), 0.0)
    found = _mixture_deviation(math.radians(5), confidence, prediction, np.float32([math.radians(350.0)]))
    assert math.degrees(found) == pytest.approx(expected_deg, abs=2.0)
