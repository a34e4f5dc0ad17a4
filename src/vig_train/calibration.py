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
from vig_train.evaluation.fits import Fits, fit_all, key_of
from vig_train.evaluation.framing import box_of_silhouette, fit_settings, framed
from vig_train.evaluation.metrics import segmentation_iou
from vig_train.training.calibration import WITHIN_90
from vig_train.training.drawing import studio_examples
from vig_train.training.examples import Examples
from vig_train.training.studio import Studio, StudioSettings
from vig_world.dataset import Dataset
from vig_world.dataset.spec import Split
from vig_world.raster.view import View

RIGHT = math.radians(15.0)
"""A view is right within this of azimuth."""
PRECISION = 0.95
"""Of trusted fits, at least this share is to be right."""
AGAINST = (
    "hidden_fraction",
    "log_residual",
    "sine_elevation",
    "log_azimuth_entropy",
    "log_elevation_deviation",
    "shape_deviation",
    "predicted_roll",
)
SIGNS = tuple(-1 if name in AGAINST else 1 for name in CONFIDENCE_FEATURES)
"""Sign of each feature's weight: confidence must not grow with a worse fit, whatever the samples say."""
IN_DISTRIBUTION_FEATURES = (
    "mask_log_probability",
    "log_azimuth_entropy",
    "log_elevation_deviation",
    "shape_deviation",
    "presence_log_odds",
    "predicted_roll",
    "outline_agreement",
)
"""Those that tell whether a photo is in distribution."""
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
"""Those that tell whether a mask is right."""
LEAST_SPREAD = 1e-3
"""Standard deviation of a feature below which it says nothing: weights would be huge."""
FOLDS = 5
LEVELS = (0.0, 0.5, 0.7, 0.8, 0.9, 0.95, 0.98, 1.01)
LEAST_GROUP = 40
"""Fits below which a group takes the deviations of all."""
ALWAYS = 20.0
"""Log odds of a photo being in distribution where no others were seen."""
ROLLED_EVERY = 2
"""Of the photos that can be, one in so many is also rolled: a photo out of distribution."""
HIGHEST_ROLLED = math.radians(50.0)
"""Elevation of the eye up to which a rolled photo is wrong: from above, it is one of another azimuth."""
ABSENT = 0.45
"""Share of a studio's photos that show something else."""
LEAST_ROLL = 20.0
"""Degrees by which such photos are rolled at least, one way or the other."""
POSITION_PHOTOS = 300
"""Photos of a dataset on which positions are calibrated, at most."""
GOLDEN = (math.sqrt(5) - 1) / 2


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
        kept, kept_outside = self.fold != fold, self.out_of_distribution_fold != fold
        return CalibrationSamples(
            **{n: a[kept_outside if n.startswith("out") else kept] for n, a in vars(self).items()}
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
        studio = Studio(object_class, StudioSettings(roll=0.03, small=0.0, absent=ABSENT), split)
        drawn = studio_examples(studio, seed, range(count))
        shown = drawn.present() > 0
        latents = latents_of(drawn.numbers, drawn.azimuth).to_vector().numpy()
        images, visible = drawn.images.numpy(), drawn.visible.numpy() > 127
        photos = StudioPhotos(images[shown], latents[shown], visible[shown], images[~shown])
        return photos, drawn[shown]

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
    """Fit all photos of datasets, each of which weighs the same whatever its size, and learn from the fits.

    Args:
        datasets: Of the validation split; and photos of a studio.
        object_class: What they show.
        recognizer: Its network, calibrated.
        settings: Of the fits, which are made without calibration; as photos are fitted by default.
        workers: See `vig_train.evaluation.evaluate`, as for cache and processes.
        advance: Is called with the number of fits made since the last call.
        cache: Folder that keeps fits, so that a run that is stopped does not begin anew.
        processes: Whether workers are processes.

    Returns:
        The calibration, and the samples that it was learned on.
    """
    plain = replace(settings or ExplainSettings(free_framing=True), calibrated=False)
    workers = workers or os.cpu_count() or 1

    def fitted(images: np.ndarray, name: str, how: ExplainSettings) -> Fits:
        key = key_of(recognizer, object_class, how)
        photos = torch.from_numpy(linear_from_srgb(images.astype(np.float32) / 255)).float()
        folder = None if cache is None else cache / name
        predicted = recognizer(photos)
        return fit_all(images, photos, predicted, object_class, how, workers, advance, folder, key, processes)

    parts = []
    for dataset in datasets:
        name = f"{len(dataset)}_{zlib.crc32(dataset.latents.tobytes()):08x}"
        if isinstance(dataset, StudioPhotos):
            images, visible, how = dataset.images, dataset.visible, plain.filled(photo=True)
            photos, origin = dataset.others, np.arange(len(dataset.others))
        else:
            (images, visible), how = framed(dataset, recognizer), fit_settings(plain, dataset)
            origin = to_roll(dataset)
            photos = rolled(images[origin], roll_angles(len(origin)))
        fits = fitted(images, name, how)
        rolled_features = fits.confidence_features[:0]
        if len(origin):
            rolled_features = fitted(photos, name + "_outside", how).confidence_features
        symmetry = object_class.symmetry
        parts.append(samples_of(fits, dataset, visible, origin, rolled_features, symmetry))
    samples = CalibrationSamples(
        *(np.concatenate(c) for c in zip(*[tuple(vars(p).values()) for p in parts], strict=True))
    )
    return learn(samples), samples


def low(dataset: Dataset | StudioPhotos) -> np.ndarray:
    """Indices of the photos of a dataset from below `HIGHEST_ROLLED`."""
    elevation = dataset.latents[:, layout_of_width(dataset.latents.shape[1]).at("elevation")]
    return np.flatnonzero(elevation < HIGHEST_ROLLED)


def to_roll(dataset: Dataset | StudioPhotos) -> np.ndarray:
    """Indices (M,) of the photos of a dataset that are rolled as well."""
    return low(dataset)[::ROLLED_EVERY]


def roll_angles(count: int) -> np.ndarray:
    """Degrees (count,) of `LEAST_ROLL` or more either way, spread evenly, and each few of them, too."""
    return LEAST_ROLL + (np.arange(count) * GOLDEN) % 1 * (360 - 2 * LEAST_ROLL)


def rolled(images: np.ndarray, degrees: np.ndarray) -> np.ndarray:
    """Photos (M, H, W, 3) uint8, each rolled about its centre; at the corners the photo comes in mirrored."""
    turned = [
        rotate(image, angle, (0, 1), reshape=False, order=1, mode="mirror")
        for image, angle in zip(images, degrees, strict=True)
    ]
    return np.stack(turned) if turned else images


def fits_of(dataset: Dataset | StudioPhotos) -> int:
    """How many fits `calibrate_fits` makes of a dataset."""
    if isinstance(dataset, StudioPhotos):
        return len(dataset) + len(dataset.others)
    return len(dataset) + len(to_roll(dataset))


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
    right = np.abs(error[:, azimuth if symmetry.fold else layout.at("elevation")]) < RIGHT
    weight = np.full(len(right), 1 / len(right))
    deviation, fold = fits.deviation.astype(np.float64), np.arange(len(right)) % FOLDS
    features, mask_right = fits.confidence_features, segmentation_iou(fits.masks, visible) >= MASK_RIGHT
    return CalibrationSamples(
        features, right, mask_right, error, deviation, weight, fold, rolled_features, origin % FOLDS
    )


def learn(samples: CalibrationSamples) -> FitCalibration:
    """The calibration that holds on samples; the threshold is chosen out of sample, by folds."""
    weights, bias = logistic(samples.features, samples.right, samples.weight)
    in_distribution_weights, in_distribution_bias = _in_distribution(samples)
    mask_weights, mask_bias = _mask(samples)
    confidence, mask_confidence, _ = out_of_fold(samples)
    threshold = least_threshold(confidence, samples.right, samples.weight)
    mask_threshold = least_threshold(mask_confidence, samples.mask_right, samples.weight)
    trusted = confidence >= threshold
    noise = residual(torch.from_numpy(samples.features)).numpy()
    scale, floor = np.empty((2, 2, samples.error.shape[1]))
    for row, group in enumerate((trusted, ~trusted)):
        chosen = group if group.sum() >= LEAST_GROUP else np.ones_like(group)
        for latent in range(samples.error.shape[1]):
            error = samples.error[chosen, latent] / noise[chosen]
            deviation, weight = samples.deviation[chosen, latent], samples.weight[chosen]
            scale[row, latent], floor[row, latent] = widening(error, deviation, weight)
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


def with_positions(
    calibration: FitCalibration,
    datasets: Sequence[Dataset | StudioPhotos],
    object_class: ObjectClass,
    recognizer: Recognizer,
    count: int = POSITION_PHOTOS,
    advance: Callable[[int], None] = lambda done: None,
) -> FitCalibration:
    """The calibration with `position` learned on photographs whose cameras are known, boxes given.

    Args:
        calibration: Says which fits are trusted.
        datasets: Those of the world "photo" are used, `count` photos of each at most; without one the
            calibration stays as it is.
        object_class: What they show.
        recognizer: Its network, calibrated.
        count: See there.
        advance: Is called with 1 for each photo.
    """
    photographs = [each for each in datasets if isinstance(each, Dataset) and each.world == "photo"]
    if not photographs:
        return calibration
    explainer = Explainer(object_class, ExplainSettings(calibration=calibration), recognizer=recognizer)
    explained = [
        posed
        for dataset in photographs
        for posed in _posed(dataset.first(count), object_class, explainer, advance)
    ]
    if len(explained) < LEAST_GROUP:
        return calibration
    errors, stated = np.array([position_error(*each) for each in explained]).transpose(1, 0, 2)
    trusted = np.array([explanation.verdict is Verdict.TRUSTED for explanation, _ in explained])
    position = np.empty((2, 3))
    for row, group in enumerate((trusted, ~trusted)):
        chosen = group if group.sum() >= LEAST_GROUP else np.ones_like(group)
        # The variance that is missing from the curvature's where 90 % of the errors are to lie within.
        missing = (errors[chosen] / WITHIN_90) ** 2 - stated[chosen] ** 2
        position[row] = np.sqrt(np.quantile(missing, 0.9, axis=0).clip(0.0))
    return replace(calibration, position=torch.from_numpy(position))


def _posed(
    dataset: Dataset, object_class: ObjectClass, explainer: Explainer, advance: Callable[[int], None]
) -> Iterator[tuple[Explanation, np.ndarray]]:
    """Photos explained with their boxes and cameras, and the true poses (4, 4); others are passed over."""
    for image, whole, spec in zip(dataset.images, dataset.amodal, dataset.specs(), strict=True):
        view = View.of_scene(spec, object_class)
        camera = view.camera.focal, view.camera.focal, view.camera.cx, view.camera.cy
        true = np.eye(4)
        true[:3, :3], true[:3, 3] = view.rotation, view.translation
        advance(1)
        if (box := box_of_silhouette(whole)) is not None:
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
    count, outside = len(samples.features), len(samples.out_of_distribution)
    found = np.empty(count), np.empty(count), np.empty(outside)
    for fold in range(FOLDS):
        others = samples.without(fold)
        view, mask = logistic(others.features, others.right, others.weight), _mask(others)
        known = _in_distribution(others)
        inside = samples.features, samples.fold == fold
        rolled = samples.out_of_distribution, samples.out_of_distribution_fold == fold
        for confidence, right, (features, here) in zip(
            found, (view, mask, view), (inside, inside, rolled), strict=True
        ):
            two = (torch.from_numpy(expit(features[here] @ w + b)) for w, b in (right, known))
            confidence[here] = faded(*two).numpy()
    return found


def _mask(samples: CalibrationSamples) -> tuple[np.ndarray, float]:
    """Weights (C,) and bias for a mask being right."""
    weights = np.zeros(len(CONFIDENCE_FEATURES))
    used = [CONFIDENCE_FEATURES.index(name) for name in MASK_FEATURES]
    signs = [SIGNS[index] for index in used]
    weights[used], bias = logistic(samples.features[:, used], samples.mask_right, samples.weight, signs)
    return weights, bias


def _in_distribution(samples: CalibrationSamples) -> tuple[np.ndarray, float]:
    """Weights (C,) and bias for a photo being in distribution; both groups weigh the same."""
    weights = np.zeros(len(CONFIDENCE_FEATURES))
    if not len(samples.out_of_distribution):
        return weights, ALWAYS
    used = [CONFIDENCE_FEATURES.index(name) for name in IN_DISTRIBUTION_FEATURES]
    features = np.concatenate([samples.features, samples.out_of_distribution])[:, used]
    known = np.arange(len(features)) < len(samples.features)
    share = np.full(len(samples.out_of_distribution), 1 / len(samples.out_of_distribution))
    weight = np.concatenate([samples.weight / samples.weight.sum(), share])
    weights[used], bias = logistic(features, known, weight, [SIGNS[index] for index in used])
    return weights, bias


def describe(calibration: FitCalibration, samples: CalibrationSamples) -> list[str]:
    """Lines on how confidence holds, of each fit by a calibration on the other folds."""
    confidence, mask_confidence, rolled_confidence = out_of_fold(samples)
    trusted = confidence >= calibration.threshold
    right = f", of which {samples.right[trusted].mean():.1%} are right" if trusted.any() else ""
    lines = [
        f"{len(trusted)} fits, {samples.right.mean():.1%} within 15 degrees of azimuth; trusted from a"
        f" confidence of {calibration.threshold:.3f}: {trusted.mean():.1%}{right}"
    ]
    sure = mask_confidence >= calibration.mask_threshold
    right = f", of which {samples.mask_right[sure].mean():.1%} are right" if sure.any() else ""
    lines.append(
        f"{samples.mask_right.mean():.1%} of masks have an IoU of {MASK_RIGHT} or more; trusted from"
        f" {calibration.mask_threshold:.3f}: {sure.mean():.1%}{right}"
    )
    if len(rolled_confidence):
        share = (rolled_confidence >= calibration.threshold).mean()
        lines.append(
            f"{len(rolled_confidence)} fits of photos rolled or without the object, of which {share:.1%}"
            " are trusted"
        )
    for low, high in zip(LEVELS[:-1], LEVELS[1:], strict=True):
        here = (confidence >= low) & (confidence < high)
        if here.any():
            lines.append(
                f"confidence {low:.2f} to {min(high, 1.0):.2f}: {here.sum()} fits, mean"
                f" {confidence[here].mean():.3f}, right {samples.right[here].mean():.3f}"
            )
    return lines


def logistic(
    features: np.ndarray, right: np.ndarray, weight: np.ndarray, signs: Sequence[int] = SIGNS
) -> tuple[np.ndarray, float]:
    """Weights (C,), of the signs given, and bias of a ridge logistic regression of right (N,) on features."""
    mean, deviation = features.mean(0), np.maximum(features.std(0), LEAST_SPREAD)
    standard, sign = (features - mean) / deviation, np.where(right, 1.0, -1.0)

    def loss(parameters: np.ndarray) -> tuple[float, np.ndarray]:
        margin = sign * (standard @ parameters[:-1] + parameters[-1])
        pull = -sign * weight / (1 + np.exp(margin))
        gradient = np.append(standard.T @ pull + 1e-3 * weight.sum() * parameters[:-1], pull.sum())
        penalty = 0.5e-3 * weight.sum() * float(parameters[:-1] @ parameters[:-1])
        return float(weight @ np.logaddexp(0, -margin)) + penalty, gradient

    bounds = [(0.0, None) if side > 0 else (None, 0.0) for side in signs] + [(None, None)]
    found = minimize(loss, np.zeros(features.shape[1] + 1), jac=True, method="L-BFGS-B", bounds=bounds).x
    weights = found[:-1] / deviation
    return weights, float(found[-1] - weights @ mean)


def least_threshold(confidence: np.ndarray, right: np.ndarray, weight: np.ndarray) -> float:
    """The lowest confidence from which on at least `PRECISION` of the fits are right, less a standard error.

    The error is that of the share itself, of so many fits as the weights stand for (Kish 1965): the lowest
    confidence that happens to do would be too low for other photos.
    """
    order = np.argsort(-confidence)
    total = np.cumsum(weight[order])
    share = np.cumsum((right * weight)[order]) / total
    error = np.sqrt(share * (1 - share) * np.cumsum(weight[order] ** 2)) / total
    enough = np.flatnonzero(share - error >= PRECISION)
    return float(confidence[order][enough[-1]]) if len(enough) else 1.0


def widening(error: np.ndarray, deviation: np.ndarray, weight: np.ndarray) -> tuple[float, float]:
    """scale and floor so that 90 % of errors lie within 1.645 sqrt((scale d)^2 + floor^2), at least width."""
    needed = np.abs(error) / WITHIN_90
    best = (math.inf, 1.0, 0.0)
    for level in np.linspace(0, 0.85, 18):
        floor = _quantile(needed, weight, level) if level else 0.0
        squares = np.maximum(0.0, needed**2 - floor**2) / np.maximum(deviation, 1e-12) ** 2
        scale = math.sqrt(_quantile(squares, weight, 0.9))
        width = float(np.average(np.sqrt((scale * deviation) ** 2 + floor**2), weights=weight))
        if width < best[0]:
            best = width, scale, floor
    return best[1:]


def _quantile(values: np.ndarray, weight: np.ndarray, level: float) -> float:
    order = np.argsort(values)
    share = np.cumsum(weight[order]) / weight.sum()
    return float(values[order][min(int(np.searchsorted(share, level)), len(values) - 1)])
