"""Confidence in a selected fit: its masks, its confidence features, the verdict and the deviations."""

import functools
import math
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np

from vig.inference.calibration import (
    CONFIDENCE_FEATURES,
    UNCALIBRATED_POSITION,
    UNCALIBRATED_WIDENING,
    WITHIN_90,
    FitCalibration,
)
from vig.inference.hints import PixelLabel, WindowHints
from vig.inference.objective import Objective
from vig.inference.refinement import DISTINCT_AZIMUTH, Selection
from vig.inference.settings import UNIFORM_TURN, ExplainSettings, Fit, OtherView, Verdict
from vig.likelihood import PixelModel, spatial_posterior
from vig.likelihood.pixel import DEFAULT_DENSITY
from vig.recognition import Prediction
from vig.recognition.prediction import bin_centres
from vig.scene import Latents, latent_layout
from vig.scene.functions import log_odds

MIN_PROBABILITY = 1e-3
"""Floor of a pixel's probability in `mask_log_probability`, so that none decides alone."""
UNINFORMED = "no network knows such objects; of the views all round this one has the most evidence"
"""Reason for doubt where views are compared by the objective alone."""
MAX_GAP = 3000.0
"""Nats at which the evidence gap is clipped."""


def make_fit(
    objective: Objective,
    selection: Selection,
    prediction: Prediction,
    settings: ExplainSettings,
    calibration: FitCalibration | None,
    confidence_prediction: Prediction | None = None,
    hints: WindowHints | None = None,
) -> Fit:
    """Make a `Fit` of a selection: masks, verdict, confidence, deviations.

    With a calibration, a fit is trusted when its confidence reaches the threshold; without, when no other
    view comes near it and the recognition model's best guess is of the same view. `objective` is that of the
    photo at its full size. `confidence_prediction` is the prediction from which the confidence is computed,
    where views were ruled out in `prediction`; `hints` are those that the prediction includes.
    """
    evidence, normal = selection.evidence, selection.normal
    if evidence is None or normal is None:
        at_fit = objective.evaluate_one(selection.point, settings.likelihood.sigma)
        assert at_fit.normal is not None
        evidence, normal = float(at_fit.value[0]), at_fit.normal[0]
    symmetry = objective.object_class.symmetry
    latents = symmetry.canonical(objective.latents(selection.point))
    shown = _render_fit(objective, selection.point, latents, settings.likelihood)
    features = _features(latents, shown, confidence_prediction or prediction, selection)
    labels = None if hints is None else hints.labels
    share = 0.0 if settings.likelihood.mask is None else settings.network_mask_share
    coverage, visible = _join_masks(shown, prediction.mask[0], labels, share)
    confidence, verdict, reason = _verdict(
        selection, features, calibration, bool((visible > 0.5).any()), settings
    )
    mask_confidence, mask_trusted = math.nan, False
    if calibration is not None:
        mask_confidence = 0.0 if verdict is Verdict.FAILED else calibration.mask_confidence(features)
        mask_trusted = mask_confidence >= calibration.mask_threshold
    deviations = _deviation(objective, normal)
    path = symmetry.canonical(objective.latents(selection.path))
    place, uniform = latent_layout(latents.shape.shape[1]).at("azimuth"), UNIFORM_TURN / max(symmetry.fold, 1)
    position = np.array(UNCALIBRATED_POSITION, np.float32)
    uncalibrated = calibration is None and settings.widened
    if uncalibrated:  # no number's above a uniform's within its bounds
        within_bounds = (objective.upper - objective.lower).astype(np.float64) / math.sqrt(12)
        deviations = np.minimum(UNCALIBRATED_WIDENING * deviations, within_bounds)
    deviation = objective.latents(deviations).to_vector()[0]
    if uncalibrated:
        # Probabilities of other views were not learned: unless trusted or given, any view is possible.
        told = hints is not None and hints.azimuth is not None
        unsure_view = verdict is not Verdict.TRUSTED and symmetry.fold > 0 and not told
        deviation[place] = uniform if unsure_view else min(float(deviation[place]), uniform)
    elif calibration is not None:
        about_view = float(calibration.widen_deviations(deviation, features, True)[place])
        deviation = calibration.widen_deviations(deviation, features, verdict is Verdict.TRUSTED)
        if verdict is not Verdict.TRUSTED:
            about_view = _mixture_deviation(
                about_view, confidence, confidence_prediction or prediction, latents.azimuth
            )
        deviation[place] = min(about_view, uniform)
        position = calibration.position[0 if verdict is Verdict.TRUSTED else 1]
    return Fit(
        latents=latents,
        framing=objective.framing(selection.point)[0],
        deviation=deviation,
        framing_deviation=objective.framing(deviations)[0],
        visible=visible,
        mask=visible > 0.5,
        mask_by_pixel=shown.by_pixel > 0.5,
        coverage=coverage,
        verdict=verdict,
        reason=reason,
        confidence=confidence,
        mask_confidence=mask_confidence,
        mask_trusted=mask_trusted,
        confidence_features=features,
        evidence=evidence,
        start_evidence=selection.start_evidence,
        evaluations=selection.evaluations,
        alternatives=_views(objective, selection, confidence_prediction or prediction, latents, confidence),
        descent=np.concatenate([path.to_vector(), objective.framing(selection.path)], axis=1),
        view_threshold=math.nan if calibration is None else calibration.threshold,
        mask_threshold=math.nan if calibration is None else calibration.mask_threshold,
        position_deviation=position,
    )


def _mixture_deviation(
    deviation: float, confidence: float, prediction: Prediction, azimuth: np.ndarray
) -> float:
    """Return the deviation, radians, of a Gaussian with the 90 % interval of the azimuth's posterior.

    The posterior is a mixture: with the confidence the fit's azimuth (1,) is right, up to a Gaussian of
    `deviation`; else views have the recognition model's probabilities, that one taken out.
    """
    off = np.abs(prediction.azimuth_offsets(azimuth))
    other = prediction.azimuth[0].astype(np.float64) * (off > DISTINCT_AZIMUTH)
    about = deviation * np.array(_half_gaussian())
    mass = np.concatenate([np.full_like(about, confidence / len(about)), other / max(other.sum(), 1e-12)])
    mass[len(about) :] *= 1 - confidence
    reach = np.concatenate([about, off.astype(np.float64)])
    order = reach.argsort(kind="stable")
    within = mass[order].cumsum() / max(mass.sum(), 1e-12)
    place = min(int(np.searchsorted(within, 0.9)), len(order) - 1)
    return float(reach[order][place]) / WITHIN_90


@functools.cache
def _half_gaussian() -> tuple[float, ...]:
    """Return 40 quantiles of a standard normal number's absolute value, in the middle of equal shares."""
    normal = NormalDist()
    return tuple(normal.inv_cdf(0.5 + 0.5 * (number + 0.5) / 40) for number in range(40))


def _views(
    objective: Objective, selection: Selection, prediction: Prediction, latents: Latents, confidence: float
) -> tuple[OtherView, ...]:
    """Return the other views of a selection.

    1 minus the fit's confidence is shared among them and all untried views, in proportion to the
    recognition model's probabilities of azimuth.
    """
    if not len(selection.others):
        return ()
    canonical = objective.object_class.symmetry.canonical(objective.latents(selection.others))
    framings = objective.framing(selection.others)
    mass = np.exp(prediction.log_mass(np.concatenate([latents.azimuth, canonical.azimuth])))
    # Where views overlap their masses may add up to more than 1 minus the fit's.
    rest = mass[1:] / max(1 - mass[0], mass[1:].sum())
    vectors = canonical.to_vector()
    return tuple(
        OtherView(
            Latents.from_vector(vectors[i : i + 1]), framings[i], (1 - confidence) * float(rest[i]), score_gap
        )
        for i, score_gap in enumerate(selection.score_gaps)
    )


@dataclass(frozen=True)
class _FitImages:
    """Images (H, W) at a fit; `visible` is the pixel model's posterior, `by_pixel` that of single pixels."""

    observed: np.ndarray
    rendered: np.ndarray
    coverage: np.ndarray
    by_pixel: np.ndarray
    visible: np.ndarray

    @property
    def amodal(self) -> np.ndarray:
        return self.coverage >= 0.5

    @property
    def mask(self) -> np.ndarray:
        return self.visible > 0.5


def _render_fit(objective: Objective, point: np.ndarray, latents: Latents, model: PixelModel) -> _FitImages:
    """Render a point (1, P') and infer its masks under their noise."""
    # 0.1: noise under which a pixel of the fit is taken as visible, as in the paper
    evaluation = objective.evaluate_one(point, 0.1, derivatives=False)
    assert (
        evaluation.coverage is not None
        and evaluation.irradiance is not None
        and evaluation.posterior is not None
    )
    coverage, posterior, likelihood = evaluation.coverage, evaluation.posterior, objective.likelihood
    observed, log_prior = (
        image.reshape(*coverage.shape, 3) for image in (likelihood.observed, likelihood.log_prior)
    )
    # A Lambertian surface of one albedo: colour = albedo x irradiance.
    rendered = evaluation.irradiance[..., None] * latents.albedo[:, None, None]
    amodal = coverage >= 0.5
    decorated = (
        np.zeros(amodal.shape[1:], coverage.dtype) if objective.decorated is None else objective.decorated
    )
    # Pixels that show another of the object's own colours are visible, too.
    posterior = posterior + (1 - posterior) * decorated.astype(posterior.dtype)
    by_pixel = visible = np.where(amodal, posterior, posterior.dtype.type(0))
    if model.mask is not None:
        visible = spatial_posterior(observed, rendered, log_prior, amodal, model.mask, decorated)
    images = (observed, rendered, coverage, by_pixel, visible)
    return _FitImages(*(image[0] for image in images))


def _join_masks(
    shown: _FitImages, predicted: np.ndarray, labels: np.ndarray | None, share: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return the coverage and visible (H, W) of a fit, joined with the network's `MASK_CLASSES` (H, W, 3).

    Means of probabilities: where the network is sure it decides, elsewhere the model does. Visible pixels are
    covered. The network knows nothing of pixels that a user labels as in front, see `PixelLabel`.
    """
    if not share:
        return shown.coverage, shown.visible
    coverage = (1 - share) * shown.coverage + share * (1 - predicted[..., 2])
    if labels is not None:
        coverage = np.where(labels == PixelLabel.IN_FRONT, shown.coverage, coverage)
    visible = (1 - share) * shown.visible + share * predicted[..., 0]
    return coverage, np.minimum(visible, coverage)


def _features(
    latents: Latents, shown: _FitImages, prediction: Prediction, selection: Selection
) -> np.ndarray:
    """Return the confidence features (C,) float64 of a fit."""
    pixels = int(shown.mask.sum())
    residual = (shown.rendered - shown.observed)[shown.mask]
    network_off = prediction.symmetry.difference(prediction.best().azimuth, latents.azimuth)[0]
    probability = prediction.azimuth[0].astype(np.float64)
    entropy = float(-(probability * np.log(np.maximum(probability, 1e-12))).sum())
    stated = prediction.layout.split(prediction.deviation[0])
    predicted = 1 - prediction.mask[0, :, :, 2] > 0.5
    union = int((shown.amodal | predicted).sum())
    centres = bin_centres(len(probability), prediction.symmetry.fold)
    rivals = centres[np.abs(prediction.azimuth_offsets(latents.azimuth)) > 2 * DISTINCT_AZIMUTH]
    features = {
        "evidence_gap": 0.0 if selection.reverted else math.log1p(min(selection.gap, MAX_GAP)),
        "view_log_probability": float(prediction.log_mass(latents.azimuth)[0]),
        "network_agrees": float(abs(float(network_off)) < DISTINCT_AZIMUTH),
        "hidden_fraction": 1 - pixels / max(1, int(shown.amodal.sum())),
        "log_visible_pixels": math.log1p(pixels),
        "log_residual": math.log(max(1e-4, math.sqrt(np.square(residual).mean()) if pixels else 1.0)),
        "sine_elevation": math.sin(float(latents.elevation[0])),
        "mask_log_probability": _mask_log_probability(prediction.mask[0], shown.mask, shown.amodal),
        "log_azimuth_entropy": math.log(max(entropy, 1e-3)),
        "log_elevation_deviation": math.log(max(float(stated["elevation"][0]), 1e-4)),
        "shape_deviation": float(stated["shape"].mean()),
        "presence_log_odds": log_odds(float(prediction.presence[0])),
        "predicted_roll": abs(float(prediction.roll[0])),
        "outline_agreement": int((shown.amodal & predicted).sum()) / max(union, 1),
        "rival_log_probability": float(prediction.log_mass(rivals).max(initial=math.log(MIN_PROBABILITY))),
    }
    return np.array([features[name] for name in CONFIDENCE_FEATURES], np.float64)


def _mask_log_probability(predicted: np.ndarray, mask: np.ndarray, amodal: np.ndarray) -> float:
    """Return the mean log probability, as predicted (H, W, 3), of a fit's classes of the object's pixels.

    The object's pixels are those that the fit covers, and those that may well show it as predicted.
    """
    visible, hidden = predicted[..., 0], predicted[..., 1]
    same = np.where(mask, visible, np.where(amodal, hidden, 1 - visible))
    # 0.3: predicted probability from which a pixel may well show the object
    about = amodal | (visible > 0.3)
    if not about.any():
        return math.log(MIN_PROBABILITY)
    return float(np.log(np.maximum(same, MIN_PROBABILITY))[about].mean())


def _verdict(
    selection: Selection,
    features: np.ndarray,
    calibration: FitCalibration | None,
    any_visible: bool,
    settings: ExplainSettings,
) -> tuple[float, Verdict, str]:
    """Return confidence, verdict and its reason.

    any_visible: Whether a pixel of the object is visible.
    """
    if calibration is None:
        confidence, trusted = math.nan, not selection.ambiguous and not selection.rival_is_other_view
    else:
        confidence = calibration.confidence(features)
        trusted = confidence >= calibration.threshold
    if not any_visible:
        return (math.nan if calibration is None else 0.0), Verdict.FAILED, Verdict.FAILED.value
    if not settings.informed:
        lead = "" if math.isinf(selection.gap) else f", by {selection.gap:.0f} nats"
        return confidence, Verdict.AMBIGUOUS, UNINFORMED + lead
    if selection.reverted:
        if calibration is not None:  # a verdict below trusted has at most 0.99 of the confidence of one
            confidence = min(confidence, 0.99 * calibration.threshold)
        return confidence, Verdict.REVERTED, Verdict.REVERTED.value
    if trusted:
        reason = Verdict.TRUSTED.value
        if calibration is None:
            reason = "no other view fits nearly as well; how often such a fit is right was not learned"
            density = settings.likelihood.density
            reason += "" if density == DEFAULT_DENSITY else f" with density '{density}'"
        return confidence, Verdict.TRUSTED, reason
    if calibration is not None and calibration.in_distribution(features) < 0.5:
        reason = "the photo is unlike those that the recognition model knows"
    elif selection.ambiguous:
        turned, gap = selection.rival_turn_deg, selection.gap
        reason = f"turned by {turned:.0f} degrees it fits nearly as well ({gap:.0f} nats less)"
    elif selection.rival_is_other_view:
        reason = f"the recognition model sees it turned by {selection.rival_turn_deg:.0f} degrees"
    # 0.3: hidden share from which that is given as the reason for doubt
    elif features[CONFIDENCE_FEATURES.index("hidden_fraction")] > 0.3:
        reason = "too little of the object is seen to be sure of its view"
    else:
        reason = low_confidence_reason(confidence, math.nan if calibration is None else calibration.threshold)
    return confidence, Verdict.AMBIGUOUS, reason


def low_confidence_reason(confidence: float, threshold: float) -> str:
    """Return the reason for doubt where there is no other than a confidence below the threshold of trust."""
    never = "" if not threshold >= 1 else "; no view of this class is trusted, see its card"
    return f"its view is right with a probability of {confidence:.0%} only{never}"


def _deviation(objective: Objective, normal: np.ndarray) -> np.ndarray:
    """Return the standard deviations (1, P') from the inverse normal matrix (P', P') of the free numbers."""
    # Held numbers have no deviation, and would make the matrix singular.
    free = objective.lower < objective.upper
    matrix = normal[free][:, free].astype(np.float64)
    matrix = matrix + 1e-9 * matrix.diagonal().max() * np.eye(len(matrix))
    deviation = np.zeros((1, len(normal)))
    deviation[0, free] = np.sqrt(np.maximum(np.linalg.inv(matrix).diagonal(), 0.0))
    return deviation
