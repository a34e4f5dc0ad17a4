"""Learns a `vig.inference.FitCalibration` on validation photos: when fits are right, how far they are off."""

from __future__ import annotations

import math
import os
import zlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from scipy.ndimage import rotate
from scipy.optimize import minimize
from scipy.special import expit

from vig.explainer import Explainer
from vig.explanation import Explanation
from vig.inference import CONFIDENCE_FEATURES, ExplainSettings, FitCalibration, Verdict
from vig.inference.calibration import faded, residual
from vig.inference.settings import MASK_RIGHT
from vig.photo.pinhole import sight_axes
from vig.recognition import Recognizer
from vig.recognition.network import latents_of
from vig.scene import Latents, ObjectClass, Symmetry, angle_difference, layout_of_width, linear_from_srgb
from vig_train.evaluation.fits import Fits, cache_key, fit_all
from vig_train.evaluation.framing import box_of_silhouette, fit_settings, frame_images
from vig_train.evaluation.metrics import segmentation_iou
from vig_train.training.calibration import WITHIN_90
from vig_train.training.drawing import studio_examples
from vig_train.training.examples import Examples
from vig_train.training.studio import Studio, StudioSettings
from vig_world.dataset import Dataset
from vig_world.dataset.spec import Split
from vig_world.raster.view import View

MAX_RIGHT_ERROR = math.radians(15.0)
"""Error of azimuth, radians, up to which a view counts as right."""
PRECISION = 0.95
"""Least share of the trusted fits that is to be right."""
NEGATIVE_FEATURES = (
    "hidden_fraction",
    "log_residual",
    "sine_elevation",
    "log_azimuth_entropy",
    "log_elevation_deviation",
    "shape_deviation",
    "predicted_roll",
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
MIN_FEATURE_DEVIATION = 1e-3
"""Least standard deviation by which a feature is standardised: a constant one would get a huge weight."""
FOLDS = 5
"""Folds of the cross-validation."""
REPORTED_LEVELS = (0.0, 0.5, 0.7, 0.8, 0.9, 0.95, 0.98, 1.01)
"""Limits of the ranges of confidence in the report."""
MIN_GROUP = 40
"""Number of fits below which a group takes the deviations of all fits."""
CERTAIN_LOG_ODDS = 20.0
"""Log odds of a photo being in distribution where the samples hold none out of distribution."""
ROLL_STRIDE = 2
"""One in so many photos from low elevations is also rolled, as a photo out of distribution."""
MAX_ROLLED_ELEVATION = math.radians(50.0)
"""Radians. A photo from below this elevation is out of distribution when rolled; one from above it looks like
a photo of another azimuth."""
ABSENT_SHARE = 0.45
"""Share of a studio's photos that show something else."""
MIN_ROLL_DEG = 20.0
"""Least roll, degrees, of a photo out of distribution."""
POSITION_PHOTOS = 300
"""Photos of a dataset on which positions are calibrated, at most."""
GOLDEN_RATIO = (math.sqrt(5) - 1) / 2
"""Its multiples modulo one spread evenly (a Weyl sequence)."""


@dataclass(frozen=True)
class CalibrationSamples:
    """Fits of N validation photos, and of M out of distribution: rolled, or without the object.

    Attributes:
        features: (N, C) confidence features.
        right: (N,) bool, whether the view is.
        mask_right: (N,) bool, whether the mask of the visible pixels is.
        error: (N, P) of the latents.
        deviation: (N, P), from the curvature.
        weight: (N,).
        fold: (N,), of the `FOLDS`.
        out_of_distribution: (M, C) confidence features of the M photos; M may be 0.
        out_of_distribution_fold: (M,), their folds: of a rolled photo, that of the photo as it was.
    """

    features: np.ndarray
    right: np.ndarray
    mask_right: np.ndarray
    error: np.ndarray
    deviation: np.ndarray
    weight: np.ndarray
    fold: np.ndarray
    out_of_distribution: np.ndarray
    out_of_distribution_fold: np.ndarray

    def without(self, fold: int) -> CalibrationSamples:
        """The same less a fold."""
        kept_in, kept_out = self.fold != fold, self.out_of_distribution_fold != fold
        return CalibrationSamples(
            **{n: a[kept_out if n.startswith("out") else kept_in] for n, a in vars(self).items()}
        )


@dataclass(frozen=True)
class StudioPhotos:
    """Photos of a studio, for what a dataset's do not show.

    Attributes:
        images: (N, H, W, 3) uint8 sRGB, which show the object.
        latents: (N, P) of these.
        visible: (N, H, W) bool, where the object is seen.
        others: (M, H, W, 3) uint8, which do not.
    """

    images: np.ndarray
    latents: np.ndarray
    visible: np.ndarray
    others: np.ndarray

    @staticmethod
    def draw(object_class: ObjectClass, split: Split, count: int, seed: int) -> tuple[StudioPhotos, Examples]:
        """The first `count` images of a seed, level ones of a split's designs; and those with the object."""
        studio = Studio(object_class, StudioSettings(roll=0.03, small=0.0, absent=ABSENT_SHARE), split)
        examples = studio_examples(studio, seed, range(count))
        shows_object = examples.present() > 0
        latents = latents_of(examples.numbers, examples.azimuth).to_vector().numpy()
        images, visible = examples.images.numpy(), examples.visible.numpy() > 127
        photos = StudioPhotos(
            images[shows_object], latents[shows_object], visible[shows_object], images[~shows_object]
        )
        return photos, examples[shows_object]

    def __len__(self) -> int:
        return len(self.images)


def calibrate_fits(
    datasets: Sequence[Dataset | StudioPhotos],
    object_class: ObjectClass,
    recognizer: Recognizer,
    settings: ExplainSettings | None = None,
    workers: int | None = None,
    advance: Callable[[int], None] = lambda done: None,
    cache: Path | None = None,
    processes: bool = False,
) -> tuple[FitCalibration, CalibrationSamples]:
    """Fit all photos of datasets, and learn a calibration on the fits; datasets weigh the same at any size.

    Args:
        datasets: Of the validation split; and photos of a studio.
        object_class: What they show.
        recognizer: Its network, calibrated.
        settings: Of the fits, which are made without calibration; as photos are fitted by default.
        workers: See `vig_train.evaluation.evaluate`, as for cache and processes.
        advance: Called with the number of fits made since the last call.
        cache: Folder that keeps fits, so that an interrupted run resumes.
        processes: Whether workers are processes.

    Returns:
        The calibration, and the samples that it was learned on.
    """
    uncalibrated = replace(settings or ExplainSettings(free_framing=True), calibrated=False)
    workers = workers or os.cpu_count() or 1

    def fitted(images: np.ndarray, name: str, photo_settings: ExplainSettings) -> Fits:
        key = cache_key(recognizer, object_class, photo_settings)
        photos = torch.from_numpy(linear_from_srgb(images.astype(np.float32) / 255)).float()
        folder = None if cache is None else cache / name
        predicted = recognizer(photos)
        return fit_all(
            images, photos, predicted, object_class, photo_settings, workers, advance, folder, key, processes
        )

    parts = []
    for dataset in datasets:
        name = f"{len(dataset)}_{zlib.crc32(dataset.latents.tobytes()):08x}"
        if isinstance(dataset, StudioPhotos):
            images, visible, photo_settings = dataset.images, dataset.visible, uncalibrated.filled(photo=True)
            photos, origin = dataset.others, np.arange(len(dataset.others))
        else:
            (images, visible), photo_settings = (
                frame_images(dataset, recognizer),
                fit_settings(uncalibrated, dataset),
            )
            origin = photos_to_roll(dataset)
            photos = roll_photos(images[origin], roll_angles(len(origin)))
        fits = fitted(images, name, photo_settings)
        rolled_features = fits.confidence_features[:0]
        if len(origin):
            rolled_features = fitted(photos, name + "_outside", photo_settings).confidence_features
        symmetry = object_class.symmetry
        parts.append(samples_of(fits, dataset, visible, origin, rolled_features, symmetry))
    samples = CalibrationSamples(
        *(np.concatenate(c) for c in zip(*[tuple(vars(p).values()) for p in parts], strict=True))
    )
    return learn(samples), samples


def low_views(dataset: Dataset | StudioPhotos) -> np.ndarray:
    """Indices of the photos of a dataset from below `MAX_ROLLED_ELEVATION`."""
    elevation = dataset.latents[:, layout_of_width(dataset.latents.shape[1]).at("elevation")]
    return np.flatnonzero(elevation < MAX_ROLLED_ELEVATION)


def photos_to_roll(dataset: Dataset | StudioPhotos) -> np.ndarray:
    """Indices (M,) of the photos of a dataset that are rolled as well."""
    return low_views(dataset)[::ROLL_STRIDE]


def roll_angles(count: int) -> np.ndarray:
    """Degrees (count,) of `MIN_ROLL_DEG` or more either way, of which each subsequence is spread evenly."""
    return MIN_ROLL_DEG + (np.arange(count) * GOLDEN_RATIO) % 1 * (360 - 2 * MIN_ROLL_DEG)


def roll_photos(images: np.ndarray, degrees: np.ndarray) -> np.ndarray:
    """Photos (M, H, W, 3) uint8, each rolled about its centre; the corners are filled by reflection."""
    rolled = [
        rotate(image, angle, (0, 1), reshape=False, order=1, mode="mirror")
        for image, angle in zip(images, degrees, strict=True)
    ]
    return np.stack(rolled) if rolled else images


def fit_count(dataset: Dataset | StudioPhotos) -> int:
    """How many fits `calibrate_fits` makes of a dataset."""
    if isinstance(dataset, StudioPhotos):
        return len(dataset) + len(dataset.others)
    return len(dataset) + len(photos_to_roll(dataset))


def samples_of(
    fits: Fits,
    dataset: Dataset | StudioPhotos,
    visible: np.ndarray,
    origin: np.ndarray,
    rolled_features: np.ndarray,
    symmetry: Symmetry = Symmetry.NONE,
) -> CalibrationSamples:
    """The samples of fits of a whole dataset, made without calibration.

    Args:
        fits: Of the photos of the dataset.
        dataset: Holds the true latents.
        visible: (N, H, W) bool, where the object is truly seen in the photos as they were fitted.
        origin: (M,) indices of the photos that were rolled, or of those without the object.
        rolled_features: (M, C) confidence features of the fits of these.
        symmetry: Of the class. Where any turn looks the same, a view is right by its elevation.
    """
    layout = layout_of_width(dataset.latents.shape[1])
    azimuth = layout.at("azimuth")
    true = Latents.from_vector(torch.from_numpy(dataset.latents))
    true = symmetry.nearest(true, torch.from_numpy(fits.latents[:, azimuth]))
    error = fits.latents.astype(np.float64) - true.to_vector().numpy()
    error[:, azimuth] = angle_difference(error[:, azimuth], np.zeros(1))
    right = np.abs(error[:, azimuth if symmetry.fold else layout.at("elevation")]) < MAX_RIGHT_ERROR
    weight = np.full(len(right), 1 / len(right))
    deviation, fold = fits.deviation.astype(np.float64), np.arange(len(right)) % FOLDS
    features, mask_right = fits.confidence_features, segmentation_iou(fits.masks, visible) >= MASK_RIGHT
    return CalibrationSamples(
        features, right, mask_right, error, deviation, weight, fold, rolled_features, origin % FOLDS
    )


def learn(samples: CalibrationSamples) -> FitCalibration:
    """Learn a calibration on samples; the thresholds are chosen out of sample, by folds."""
    weights, bias = logistic(samples.features, samples.right, samples.weight)
    in_distribution_weights, in_distribution_bias = _in_distribution_weights(samples)
    mask_weights, mask_bias = _mask_weights(samples)
    confidence, mask_confidence, _ = out_of_fold(samples)
    threshold = lowest_threshold(confidence, samples.right, samples.weight)
    mask_threshold = lowest_threshold(mask_confidence, samples.mask_right, samples.weight)
    trusted = confidence >= threshold
    noise = residual(torch.from_numpy(samples.features)).numpy()
    scale, floor = np.empty((2, 2, samples.error.shape[1]))
    for row, group in enumerate((trusted, ~trusted)):
        chosen = group if group.sum() >= MIN_GROUP else np.ones_like(group)
        for latent in range(samples.error.shape[1]):
            error = samples.error[chosen, latent] / noise[chosen]
            deviation, weight = samples.deviation[chosen, latent], samples.weight[chosen]
            scale[row, latent], floor[row, latent] = deviation_scale_and_floor(error, deviation, weight)
    return FitCalibration(
        torch.from_numpy(weights),
        bias,
        torch.from_numpy(in_distribution_weights),
        in_distribution_bias,
        torch.from_numpy(mask_weights),
        mask_bias,
        threshold,
        mask_threshold,
        torch.from_numpy(scale),
        torch.from_numpy(floor),
    )


def calibrate_positions(
    calibration: FitCalibration,
    datasets: Sequence[Dataset | StudioPhotos],
    object_class: ObjectClass,
    recognizer: Recognizer,
    count: int = POSITION_PHOTOS,
    advance: Callable[[int], None] = lambda done: None,
) -> FitCalibration:
    """The calibration with `position` learned on photographs whose cameras are known, boxes given.

    Args:
        calibration: Decides which fits are trusted.
        datasets: Those of the world "photo" are used, `count` photos of each at most; without one the
            calibration stays as it is.
        object_class: What they show.
        recognizer: Its network, calibrated.
        count: See there.
        advance: Is called with 1 for each photo.
    """
    photographs = [
        dataset for dataset in datasets if isinstance(dataset, Dataset) and dataset.world == "photo"
    ]
    if not photographs:
        return calibration
    explainer = Explainer(object_class, ExplainSettings(calibration=calibration), recognizer=recognizer)
    explained = [
        posed
        for dataset in photographs
        for posed in _explained_photos(dataset.first(count), object_class, explainer, advance)
    ]
    if len(explained) < MIN_GROUP:
        return calibration
    errors, stated = np.array([position_error(*posed) for posed in explained]).transpose(1, 0, 2)
    trusted = np.array([explanation.verdict is Verdict.TRUSTED for explanation, _ in explained])
    position = np.empty((2, 3))
    for row, group in enumerate((trusted, ~trusted)):
        chosen = group if group.sum() >= MIN_GROUP else np.ones_like(group)
        # The variance to add to the curvature's so that 90 % of errors lie within the 90 % interval.
        missing = (errors[chosen] / WITHIN_90) ** 2 - stated[chosen] ** 2
        position[row] = np.sqrt(np.quantile(missing, 0.9, axis=0).clip(0.0))
    return replace(calibration, position=torch.from_numpy(position))


def _explained_photos(
    dataset: Dataset, object_class: ObjectClass, explainer: Explainer, advance: Callable[[int], None]
) -> Iterator[tuple[Explanation, np.ndarray]]:
    """Photos explained with their boxes and cameras, and the true poses (4, 4); others are passed over."""
    for image, silhouette, spec in zip(dataset.images, dataset.amodal, dataset.specs(), strict=True):
        view = View.of_scene(spec, object_class)
        camera = view.camera.focal, view.camera.focal, view.camera.cx, view.camera.cy
        true = np.eye(4)
        true[:3, :3], true[:3, 3] = view.rotation, view.translation
        advance(1)
        if (box := box_of_silhouette(silhouette)) is not None:
            yield explainer.explain(image, box, camera=camera), true


def position_error(explanation: Explanation, true: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Errors (3,) of a position in the units of `FitCalibration.position`, and the curvature's deviations.

    true: (4, 4) camera_from_object.
    """
    _, pose, covariance = explanation.pinhole_pose()
    axes, units = sight_axes(pose), explanation.position_units
    widened = np.square(explanation.fit.position_deviation.numpy() * units)
    variance = np.diag(axes.T @ covariance[:3, :3] @ axes) - widened
    return np.abs(axes.T @ (pose[:3, 3] - true[:3, 3])) / units, np.sqrt(variance.clip(0.0)) / units


def out_of_fold(samples: CalibrationSamples) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Confidence in the view (N,) and in the mask (N,) of each fit, and in the view (M,) of rolled photos.

    Each is by a calibration on the other folds.
    """
    count, outside_count = len(samples.features), len(samples.out_of_distribution)
    confidences = np.empty(count), np.empty(count), np.empty(outside_count)
    for fold in range(FOLDS):
        training = samples.without(fold)
        view, mask = logistic(training.features, training.right, training.weight), _mask_weights(training)
        in_distribution = _in_distribution_weights(training)
        inside = samples.features, samples.fold == fold
        outside_distribution = samples.out_of_distribution, samples.out_of_distribution_fold == fold
        for confidence, right_model, (features, in_fold) in zip(
            confidences, (view, mask, view), (inside, inside, outside_distribution), strict=True
        ):
            probabilities = (
                torch.from_numpy(expit(features[in_fold] @ w + b)) for w, b in (right_model, in_distribution)
            )
            confidence[in_fold] = faded(*probabilities).numpy()
    return confidences


def _mask_weights(samples: CalibrationSamples) -> tuple[np.ndarray, float]:
    """Weights (C,) and bias for a mask being right."""
    weights = np.zeros(len(CONFIDENCE_FEATURES))
    used = [CONFIDENCE_FEATURES.index(name) for name in MASK_FEATURES]
    signs = [SIGNS[index] for index in used]
    weights[used], bias = logistic(samples.features[:, used], samples.mask_right, samples.weight, signs)
    return weights, bias


def _in_distribution_weights(samples: CalibrationSamples) -> tuple[np.ndarray, float]:
    """Weights (C,) and bias for a photo being in distribution; both groups weigh the same."""
    weights = np.zeros(len(CONFIDENCE_FEATURES))
    if not len(samples.out_of_distribution):
        return weights, CERTAIN_LOG_ODDS
    used = [CONFIDENCE_FEATURES.index(name) for name in IN_DISTRIBUTION_FEATURES]
    features = np.concatenate([samples.features, samples.out_of_distribution])[:, used]
    is_in_distribution = np.arange(len(features)) < len(samples.features)
    share = np.full(len(samples.out_of_distribution), 1 / len(samples.out_of_distribution))
    weight = np.concatenate([samples.weight / samples.weight.sum(), share])
    weights[used], bias = logistic(features, is_in_distribution, weight, [SIGNS[index] for index in used])
    return weights, bias


def describe(calibration: FitCalibration, samples: CalibrationSamples) -> list[str]:
    """Lines on the confidence's reliability out of sample: each fit by a calibration on the other folds."""
    confidence, mask_confidence, rolled_confidence = out_of_fold(samples)
    trusted = confidence >= calibration.threshold
    right = f", of which {samples.right[trusted].mean():.1%} are right" if trusted.any() else ""
    lines = [
        f"{len(trusted)} fits, {samples.right.mean():.1%} within 15 degrees of azimuth; trusted from a"
        f" confidence of {calibration.threshold:.3f}: {trusted.mean():.1%}{right}"
    ]
    mask_trusted = mask_confidence >= calibration.mask_threshold
    right = (
        f", of which {samples.mask_right[mask_trusted].mean():.1%} are right" if mask_trusted.any() else ""
    )
    lines.append(
        f"{samples.mask_right.mean():.1%} of masks have an IoU of {MASK_RIGHT} or more; trusted from"
        f" {calibration.mask_threshold:.3f}: {mask_trusted.mean():.1%}{right}"
    )
    if len(rolled_confidence):
        trusted_share = (rolled_confidence >= calibration.threshold).mean()
        lines.append(
            f"{len(rolled_confidence)} fits of photos rolled or without the object, of which"
            f" {trusted_share:.1%} are trusted"
        )
    for low, high in zip(REPORTED_LEVELS[:-1], REPORTED_LEVELS[1:], strict=True):
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
    """Weights (C,), of the signs given, and bias of a ridge logistic regression of right (N,) on features."""
    mean, deviation = features.mean(0), np.maximum(features.std(0), MIN_FEATURE_DEVIATION)
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


def lowest_threshold(confidence: np.ndarray, right: np.ndarray, weight: np.ndarray) -> float:
    """The lowest threshold at which the precision less its standard error is at least `PRECISION`.

    The standard error is sqrt(p (1 - p) / n), n the effective number of fits under the weights (Kish 1965).
    Without it, the threshold chosen on these fits would be too low for other photos.
    """
    order = np.argsort(-confidence)
    total = np.cumsum(weight[order])
    share = np.cumsum((right * weight)[order]) / total
    error = np.sqrt(share * (1 - share) * np.cumsum(weight[order] ** 2)) / total
    enough = np.flatnonzero(share - error >= PRECISION)
    return float(confidence[order][enough[-1]]) if len(enough) else 1.0


def deviation_scale_and_floor(
    error: np.ndarray, deviation: np.ndarray, weight: np.ndarray
) -> tuple[float, float]:
    """scale and floor such that 90 % of errors lie within 1.645 sqrt((scale d)^2 + floor^2).

    Of all such pairs that of least mean width is taken. The floor is searched over quantiles of the errors;
    the scale follows from it.
    """
    required_deviation = np.abs(error) / WITHIN_90
    best = (math.inf, 1.0, 0.0)
    for level in np.linspace(0, 0.85, 18):
        floor = _quantile(required_deviation, weight, level) if level else 0.0
        squares = np.maximum(0.0, required_deviation**2 - floor**2) / np.maximum(deviation, 1e-12) ** 2
        scale = math.sqrt(_quantile(squares, weight, 0.9))
        width = float(np.average(np.sqrt((scale * deviation) ** 2 + floor**2), weights=weight))
        if width < best[0]:
            best = width, scale, floor
    return best[1:]


def _quantile(values: np.ndarray, weight: np.ndarray, level: float) -> float:
    order = np.argsort(values)
    share = np.cumsum(weight[order]) / weight.sum()
    return float(values[order][min(int(np.searchsorted(share, level)), len(values) - 1)])
