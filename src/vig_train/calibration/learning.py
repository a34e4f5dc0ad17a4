"""A calibration learned on samples: logistic regressions, thresholds, deviations."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.optimize import minimize
from scipy.special import expit

from vig.inference import CONFIDENCE_FEATURES, FitCalibration
from vig.inference.calibration import WITHIN_90, fade_confidence, residual
from vig.inference.settings import MASK_RIGHT
from vig.io.checks import read_tensors, reading

PRECISION = 0.95  # least share of the trusted fits that is to be right
NEGATIVE_FEATURES = (
    "hidden_fraction",
    "log_residual",
    "log_azimuth_entropy",
    "log_elevation_deviation",
    "shape_deviation",
    "predicted_roll",
    "rival_log_probability",
)
"""Features that lower the confidence as they grow."""
SIGNS = tuple(-1 if name in NEGATIVE_FEATURES else 1 for name in CONFIDENCE_FEATURES)
"""Sign that a feature's weight may have: confidence must not grow with a worse fit, whatever the samples."""
IN_DISTRIBUTION_FEATURES = (
    "mask_log_probability",
    "log_azimuth_entropy",
    "log_elevation_deviation",
    "shape_deviation",
    "presence_log_odds",
    "predicted_roll",
    "outline_agreement",
)
"""Features by which a photo is judged to be in distribution."""
VIEW_FEATURES = (
    "evidence_gap",
    "view_log_probability",
    "hidden_fraction",
    "outline_agreement",
    "rival_log_probability",
)
"""Features by which a view is judged to be right. Others are evidence for a view in rendered photos but not
in real ones: the entropy's area under the curve is .67 on rendered cars, .38 on real ones. Chosen on the
photos of docs/own_class.md, of cars and animals, no worse for mugs."""
MASK_FEATURES = (
    "view_log_probability",
    "network_agrees",
    "hidden_fraction",
    "log_visible_pixels",
    "log_residual",
    "mask_log_probability",
    "log_elevation_deviation",
    "shape_deviation",
    "presence_log_odds",
    "outline_agreement",
)
"""Features by which a mask is judged to be right."""
FOLDS = 20
"""Folds of the cross-validation. With five a threshold hangs on which photos are in which fold."""
RELIABILITY_FILE = Path(__file__).with_name("reliability.safetensors")
"""Confidences of other classes, and whether these views were right: `python -m benchmarks.reliability`."""
MIN_THRESHOLD = 0.7
"""Confidence below which nothing is trusted, however often the rest is right: set, not fitted."""
MIN_GROUP = 40  # number of fits below which a group takes the deviations of others


@dataclass(frozen=True)
class CalibrationSamples:
    """Fits of N validation photos, and of M out of distribution: rolled, or without the object.

    Attributes:
        features: (N, C) confidence features.
        right: (N,) bool, whether the view is.
        mask_right: (N,) bool, whether the mask of the visible pixels is.
        error: (N, P) errors of the latents.
        deviation: (N, P), from the curvature.
        weight: (N,).
        fold: (N,), number of one of the `FOLDS`.
        model: (N,) int, the mesh or design that each shows; fits of one are not independent.
        out_of_distribution: (M, C) confidence features of the M photos; M may be 0.
        out_of_distribution_fold: (M,), their folds: for a rolled photo, that of the original.
    """

    features: np.ndarray
    right: np.ndarray
    mask_right: np.ndarray
    error: np.ndarray
    deviation: np.ndarray
    weight: np.ndarray
    fold: np.ndarray
    model: np.ndarray
    out_of_distribution: np.ndarray
    out_of_distribution_fold: np.ndarray

    def without(self, fold: int) -> "CalibrationSamples":
        """Return the samples without a fold."""
        kept_in, kept_out = self.fold != fold, self.out_of_distribution_fold != fold
        return CalibrationSamples(
            **{n: a[kept_out if n.startswith("out") else kept_in] for n, a in vars(self).items()}
        )


def learn(samples: CalibrationSamples, pooled: bool = False) -> FitCalibration:
    """Learn a calibration on samples; the thresholds are chosen out of sample, by folds.

    pooled: Whether the threshold of views is chosen on fits of other classes, too, see `pooled_threshold`.
    """
    view, in_distribution, mask = _models(samples)
    confidence, mask_confidence, _ = out_of_fold(samples)
    threshold_of = pooled_threshold if pooled else lowest_threshold
    threshold = threshold_of(confidence, samples.right, samples.weight, samples.model)
    mask_threshold = lowest_threshold(mask_confidence, samples.mask_right, samples.weight, samples.model)
    trusted = confidence >= threshold
    noise = residual(samples.features)
    scale, floor = np.empty((2, 2, samples.error.shape[1]))
    for row, group in enumerate((trusted, ~trusted)):
        # Where few are trusted the right ones stand for them, elsewhere all.
        substitute = samples.right if row == 0 and samples.right.sum() >= MIN_GROUP else np.ones_like(group)
        chosen = group if group.sum() >= MIN_GROUP else substitute
        for latent in range(samples.error.shape[1]):
            error = samples.error[chosen, latent] / noise[chosen]
            deviation, weight = samples.deviation[chosen, latent], samples.weight[chosen]
            scale[row, latent], floor[row, latent] = deviation_scale_and_floor(
                error, deviation, weight, samples.model[chosen]
            )
    return FitCalibration(*view, *in_distribution, *mask, threshold, mask_threshold, scale, floor)


def out_of_fold(samples: CalibrationSamples) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return confidence in the view (N,) and mask (N,) of each fit, and in the view (M,) of rolled photos.

    Each is by a calibration on the other folds.
    """
    count, outside_count = len(samples.features), len(samples.out_of_distribution)
    confidences = np.empty(count), np.empty(count), np.empty(outside_count)
    for fold in range(FOLDS):
        view, in_distribution, mask = _models(samples.without(fold))
        inside = samples.features, samples.fold == fold
        outside_distribution = samples.out_of_distribution, samples.out_of_distribution_fold == fold
        for confidence, right_model, (features, in_fold) in zip(
            confidences, (view, mask, view), (inside, inside, outside_distribution), strict=True
        ):
            probabilities = (expit(features[in_fold] @ w + b) for w, b in (right_model, in_distribution))
            confidence[in_fold] = fade_confidence(*probabilities)
    return confidences


LinearModel = tuple[np.ndarray, float]  # weights (C,) and bias of a logistic regression


def _models(samples: CalibrationSamples) -> tuple[LinearModel, LinearModel, LinearModel]:
    """Return the models of a view being right, a photo being in distribution, and a mask being right."""
    view = _weights_of(VIEW_FEATURES, samples.features, samples.right, samples.weight)
    mask = _weights_of(MASK_FEATURES, samples.features, samples.mask_right, samples.weight)
    return view, _in_distribution_weights(samples), mask


def _weights_of(
    names: Sequence[str], features: np.ndarray, right: np.ndarray, weight: np.ndarray
) -> LinearModel:
    """Return weights (C,), 0 but for the features that are named, and bias, see `logistic`."""
    weights = np.zeros(len(CONFIDENCE_FEATURES))
    used = [CONFIDENCE_FEATURES.index(name) for name in names]
    weights[used], bias = logistic(features[:, used], right, weight, [SIGNS[index] for index in used])
    return weights, bias


def _in_distribution_weights(samples: CalibrationSamples) -> LinearModel:
    """Return weights (C,) and bias for a photo being in distribution; both groups weigh the same."""
    if not len(samples.out_of_distribution):
        # Log odds of 20, as nothing is known of photos out of distribution.
        return np.zeros(len(CONFIDENCE_FEATURES)), 20.0
    features = np.concatenate([samples.features, samples.out_of_distribution])
    is_in_distribution = np.arange(len(features)) < len(samples.features)
    share = np.full(len(samples.out_of_distribution), 1 / len(samples.out_of_distribution))
    weight = np.concatenate([samples.weight / samples.weight.sum(), share])
    return _weights_of(IN_DISTRIBUTION_FEATURES, features, is_in_distribution, weight)


def describe(calibration: FitCalibration, samples: CalibrationSamples) -> list[str]:
    """Return lines on the confidence's reliability out of sample: each fit by calibration on other folds."""
    confidence, mask_confidence, rolled_confidence = out_of_fold(samples)

    def trust(confidence: np.ndarray, right: np.ndarray, threshold: float) -> str:
        trusted = confidence >= threshold
        precision = f", of which {right[trusted].mean():.1%} are right" if trusted.any() else ""
        return f"trusted from a confidence of {threshold:.3f}: {trusted.mean():.1%}{precision}"

    lines = [
        f"{len(confidence)} fits, {samples.right.mean():.1%} within 15 degrees of azimuth; "
        + trust(confidence, samples.right, calibration.threshold),
        f"{samples.mask_right.mean():.1%} of masks have an IoU of {MASK_RIGHT} or more; "
        + trust(mask_confidence, samples.mask_right, calibration.mask_threshold),
    ]
    if len(rolled_confidence):
        trusted_share = (rolled_confidence >= calibration.threshold).mean()
        lines.append(
            f"{len(rolled_confidence)} fits of photos rolled or without the object, of which"
            f" {trusted_share:.1%} are trusted"
        )
    # Limits of the ranges of confidence in the report.
    reported_levels = (0.0, 0.5, 0.7, 0.8, 0.9, 0.95, 0.98, 1.01)
    for low, high in zip(reported_levels[:-1], reported_levels[1:], strict=True):
        in_range = (confidence >= low) & (confidence < high)
        if in_range.any():
            lines.append(
                f"confidence {low:.2f} to {min(high, 1.0):.2f}: {in_range.sum()} fits, mean"
                f" {confidence[in_range].mean():.3f}, right {samples.right[in_range].mean():.3f}"
            )
    return lines


def logistic(
    features: np.ndarray, right: np.ndarray, weight: np.ndarray, signs: Sequence[int] = SIGNS
) -> tuple[np.ndarray, float]:
    """Return weights (C,) of given signs and bias: a ridge logistic regression of right (N,) on features."""
    # A constant feature would get a huge weight.
    mean, deviation = features.mean(0), np.maximum(features.std(0), 1e-3)
    standard, sign = (features - mean) / deviation, np.where(right, 1.0, -1.0)

    def loss(parameters: np.ndarray) -> tuple[float, np.ndarray]:
        margin = sign * (standard @ parameters[:-1] + parameters[-1])
        loss_slope = -sign * weight / (1 + np.exp(margin))
        gradient = np.append(
            standard.T @ loss_slope + 1e-3 * weight.sum() * parameters[:-1], loss_slope.sum()
        )
        penalty = 0.5e-3 * weight.sum() * float(parameters[:-1] @ parameters[:-1])
        return float(weight @ np.logaddexp(0, -margin)) + penalty, gradient

    bounds = [(0.0, None) if sign_bound > 0 else (None, 0.0) for sign_bound in signs] + [(None, None)]
    optimum = minimize(loss, np.zeros(features.shape[1] + 1), jac=True, method="L-BFGS-B", bounds=bounds).x
    weights = optimum[:-1] / deviation
    return weights, float(optimum[-1] - weights @ mean)


def pooled_threshold(
    confidence: np.ndarray, right: np.ndarray, weight: np.ndarray, model: np.ndarray
) -> float:
    """Return the threshold of `lowest_threshold` for a class's own fits and those of other classes together.

    A dozen meshes alone say too little: from half of them 6 to 50 % of the thresholds are 1.0.
    """
    with reading(RELIABILITY_FILE, "confidences of other classes", "Install vig again."):
        others, _ = read_tensors(RELIABILITY_FILE)
    # Weight of a class's own fits in its threshold; those of other classes have the rest. Chosen on rendered
    # photos: threshold from half of the meshes of a class, precision on the other half (docs/own_class.md).
    own_weight = 0.3
    return lowest_threshold(
        np.concatenate([confidence, others["confidence"]]),
        np.concatenate([right, others["right"] > 0]),
        np.concatenate([own_weight * weight / weight.sum(), (1 - own_weight) * others["weight"]]),
        np.concatenate([model, others["model"] + model.max(initial=0) + 1]),
    )


def lowest_threshold(
    confidence: np.ndarray, right: np.ndarray, weight: np.ndarray, model: np.ndarray | None = None
) -> float:
    """Return the lowest threshold at which the precision less its standard error is at least `PRECISION`.

    It is at least `MIN_THRESHOLD`. The standard error is robust to correlation among fits of one
    `model` (N,) (Liang and Zeger 1986): where all errors come from a few meshes, others may be like them.
    By default each fit is by itself. Without the standard error, the threshold chosen on these fits would be
    too low for other photos.
    """
    order = np.argsort(-confidence)
    total = np.cumsum(weight[order])
    share = np.cumsum((right * weight)[order]) / total
    groups = np.arange(len(order)) if model is None else np.unique(model[order], return_inverse=True)[1]
    # Sums up to each fit of a group's weights, and of those of its right ones: (groups, N).
    member = groups == np.arange(groups.max(initial=0) + 1)[:, None]
    of_group = np.cumsum(member * weight[order], 1)
    right_of_group = np.cumsum(member * (right * weight)[order], 1)
    present = (of_group > 0).sum(0)
    factor = present / np.maximum(present - 1, 1)
    error = np.sqrt(factor * ((right_of_group - share * of_group) ** 2).sum(0)) / total
    # With few fits or groups that is too small by chance: at least that of as many independent ones, one
    # right and one wrong added (Agresti and Coull 1998).
    count = total**2 / np.cumsum(weight[order] ** 2)
    expected = (share * count + 1) / (count + 2)
    error = np.maximum(error, np.sqrt(expected * (1 - expected) / count))
    enough = np.flatnonzero(share - error >= PRECISION)
    return max(float(confidence[order][enough[-1]]), MIN_THRESHOLD) if len(enough) else 1.0


def deviation_scale_and_floor(
    error: np.ndarray, deviation: np.ndarray, weight: np.ndarray, model: np.ndarray | None = None
) -> tuple[float, float]:
    """Return scale and floor such that 90 % of errors lie within 1.645 sqrt((scale d)^2 + floor^2).

    They hold more, by that share's standard error, robust to correlation among fits of one `model` (N,):
    other photos show other meshes.
    """
    # Share of errors that intervals of 1.645 deviations are to hold, and the most that they are widened to.
    coverage, most_coverage = 0.9, 0.98
    scale, floor = _narrowest(error, deviation, weight, coverage)
    within = np.abs(error) <= WITHIN_90 * np.sqrt((scale * deviation) ** 2 + floor**2)
    groups = np.arange(len(error)) if model is None else np.unique(model, return_inverse=True)[1]
    off = np.bincount(groups, weight * (within - np.average(within, weights=weight)))
    margin = math.sqrt(float(off @ off) * len(off) / max(len(off) - 1, 1)) / float(weight.sum())
    return _narrowest(error, deviation, weight, min(coverage + margin, most_coverage))


def _narrowest(
    error: np.ndarray, deviation: np.ndarray, weight: np.ndarray, coverage: float
) -> tuple[float, float]:
    """Return the scale and floor of least mean width whose intervals hold this share of the errors.

    The floor is searched over quantiles of the errors; the scale follows from it.
    """
    required_deviation = np.abs(error) / WITHIN_90
    best = (math.inf, 1.0, 0.0)
    for level in np.linspace(0, 0.85, 18):
        floor = _quantile(required_deviation, weight, level) if level else 0.0
        squares = np.maximum(0.0, required_deviation**2 - floor**2) / np.maximum(deviation, 1e-12) ** 2
        scale = math.sqrt(_quantile(squares, weight, coverage))
        width = float(np.average(np.sqrt((scale * deviation) ** 2 + floor**2), weights=weight))
        if width < best[0]:
            best = width, scale, floor
    return best[1:]


def _quantile(values: np.ndarray, weight: np.ndarray, level: float) -> float:
    order = np.argsort(values)
    share = np.cumsum(weight[order]) / weight.sum()
    return float(values[order][min(int(np.searchsorted(share, level)), len(values) - 1)])
