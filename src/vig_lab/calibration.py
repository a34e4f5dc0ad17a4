"""Learns on validation photos when fits are right and how far they are off: `vig.inference.Calibration`."""

from __future__ import annotations

import math
import os
import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from scipy.ndimage import rotate
from scipy.optimize import minimize
from scipy.special import expit

from vig.dataset import Dataset
from vig.inference import Calibration, ExplainSettings
from vig.inference.calibration import CLUES, KIND, faded, residual
from vig.recognition import Recognizer
from vig.scene import ObjectClass, angle_difference, layout_of_width, linear_from_srgb
from vig_lab.evaluation.fits import Fits, fit_all, key_of

RIGHT = math.radians(15.0)
"""A view is right within this."""
PRECISION = 0.98
"""Of trusted fits, at least this share is to be right; 0.95 is what is promised."""
WITHIN_90 = 1.6449
AGAINST = ("hidden", "misfit", "height", "spread", "elevation_doubt", "shape_doubt", "roll")
SIGNS = tuple(-1 if clue in AGAINST else 1 for clue in CLUES)
"""Which way each clue may speak: trust must not grow with a worse fit, whatever a sample of photos says."""
FOLDS = 5
LEVELS = (0.0, 0.5, 0.7, 0.8, 0.9, 0.95, 0.98, 1.01)
LEAST = 40
"""Fits below which a group is not told apart from all."""
ALWAYS = 20.0
"""Log odds of a photo being of the known kind where no other kind was seen."""
ROLLED_EVERY = 2
"""Of the photos that can be, one in so many is rolled, too: a photo of an unknown kind."""
HIGHEST_ROLLED = math.radians(50.0)
"""Elevation of the eye up to which a rolled photo is wrong: from above, it is one of another azimuth."""
LEAST_ROLL = 20.0
"""Degrees by which such photos are rolled at least, one way or the other."""
GOLDEN = (math.sqrt(5) - 1) / 2


@dataclass(frozen=True)
class Lessons:
    """Fits of validation photos: clues (N, C), right (N,) bool, errors and deviations (N, P), weight (N,).

    strange (M, C): clues of fits of photos of an unknown kind, there being none when M is 0. fold (N,),
    strange_fold (M,): of the `FOLDS`; a photo made of another is in the other's.
    """

    clues: np.ndarray
    right: np.ndarray
    error: np.ndarray
    deviation: np.ndarray
    weight: np.ndarray
    fold: np.ndarray
    strange: np.ndarray
    strange_fold: np.ndarray

    def without(self, fold: int) -> Lessons:
        """The same less a fold."""
        kept, kept_strange = self.fold != fold, self.strange_fold != fold
        return Lessons(
            **{n: a[kept_strange if n.startswith("strange") else kept] for n, a in vars(self).items()}
        )


def calibrate_fits(
    datasets: Sequence[Dataset],
    object_class: ObjectClass,
    recognizer: Recognizer,
    settings: ExplainSettings | None = None,
    workers: int | None = None,
    advance: Callable[[int], None] = lambda done: None,
    cache: Path | None = None,
    processes: bool = False,
) -> tuple[Calibration, Lessons]:
    """Fit all photos of datasets, each of which counts alike whatever its size, and learn from them.

    workers, cache, processes: see `vig_lab.evaluation.evaluate`.
    """
    plain = replace(settings or ExplainSettings(), calibrated=False)
    workers = workers or os.cpu_count() or 1
    key = key_of(recognizer, object_class, plain)

    def fitted(images: np.ndarray, name: str) -> Fits:
        photos = torch.from_numpy(linear_from_srgb(images.astype(np.float32) / 255)).float()
        folder = None if cache is None else cache / name
        said = recognizer(photos)
        return fit_all(images, photos, said, object_class, plain, workers, advance, folder, key, processes)

    parts = []
    for dataset in datasets:
        name = f"{len(dataset)}_{zlib.crc32(dataset.latents.tobytes()):08x}"
        fits, origin = fitted(dataset.images, name), to_roll(dataset)
        strange = fits.clues[:0]
        if len(origin):
            photos = rolled(dataset.images[origin], roll_angles(len(origin)))
            strange = fitted(photos, name + "_rolled").clues
        parts.append(lessons_of(fits, dataset, origin, strange))
    lessons = Lessons(
        *(np.concatenate(c) for c in zip(*[tuple(vars(p).values()) for p in parts], strict=True))
    )
    return learn(lessons), lessons


def low(dataset: Dataset) -> np.ndarray:
    """Indices of the photos of a dataset from below `HIGHEST_ROLLED`."""
    return np.flatnonzero(
        dataset.latents[:, layout_of_width(dataset.latents.shape[1]).at("elevation")] < HIGHEST_ROLLED
    )


def to_roll(dataset: Dataset) -> np.ndarray:
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


def fits_of(dataset: Dataset) -> int:
    """How many fits `calibrate_fits` makes of a dataset."""
    return len(dataset) + len(to_roll(dataset))


def lessons_of(fits: Fits, dataset: Dataset, origin: np.ndarray, strange: np.ndarray) -> Lessons:
    """What fits of a whole dataset, not calibrated, teach.

    strange (M, C): clues of photos that were rolled; origin (M,): indices of these photos.
    """
    error = fits.latents.astype(np.float64) - dataset.latents
    azimuth = layout_of_width(error.shape[1]).at("azimuth")
    error[:, azimuth] = angle_difference(error[:, azimuth], np.zeros(1))
    right = np.abs(error[:, azimuth]) < RIGHT
    weight = np.full(len(right), 1 / len(right))
    deviation, fold = fits.deviation.astype(np.float64), np.arange(len(right)) % FOLDS
    return Lessons(fits.clues, right, error, deviation, weight, fold, strange, origin % FOLDS)


def learn(fits: Lessons) -> Calibration:
    """The calibration that holds on fits; the threshold is chosen out of sample, by folds."""
    weights, bias = logistic(fits.clues, fits.right, fits.weight)
    kind_weights, kind_bias = _kind(fits)
    confidence, _ = out_of_fold(fits)
    threshold = least_threshold(confidence, fits.right, fits.weight)
    trusted = confidence >= threshold
    noise = residual(torch.from_numpy(fits.clues)).numpy()
    scale, floor = np.empty((2, 2, fits.error.shape[1]))
    for row, group in enumerate((trusted, ~trusted)):
        chosen = group if group.sum() >= LEAST else np.ones_like(group)
        for latent in range(fits.error.shape[1]):
            error, deviation = fits.error[chosen, latent] / noise[chosen], fits.deviation[chosen, latent]
            scale[row, latent], floor[row, latent] = widening(error, deviation, fits.weight[chosen])
    return Calibration(
        torch.from_numpy(weights),
        bias,
        torch.from_numpy(kind_weights),
        kind_bias,
        threshold,
        torch.from_numpy(scale),
        torch.from_numpy(floor),
    )


def out_of_fold(fits: Lessons) -> tuple[np.ndarray, np.ndarray]:
    """Confidence in each fit (N,), and in each of a strange photo (M,), by what the other folds teach."""
    found = np.empty(len(fits.clues)), np.empty(len(fits.strange))
    for fold in range(FOLDS):
        others = fits.without(fold)
        (w, b), (k, c) = logistic(others.clues, others.right, others.weight), _kind(others)
        groups = (fits.clues, fits.fold == fold), (fits.strange, fits.strange_fold == fold)
        for confidence, (clues, here) in zip(found, groups, strict=True):
            view, known = (torch.from_numpy(expit(clues[here] @ x + y)) for x, y in ((w, b), (k, c)))
            confidence[here] = faded(view, known).numpy()
    return found


def _kind(fits: Lessons) -> tuple[np.ndarray, float]:
    """Weights (C,) and bias for a photo being of the known kind; either kind counts alike."""
    weights = np.zeros(len(CLUES))
    if not len(fits.strange):
        return weights, ALWAYS
    used = [CLUES.index(clue) for clue in KIND]
    clues = np.concatenate([fits.clues, fits.strange])[:, used]
    known = np.arange(len(clues)) < len(fits.clues)
    share = np.full(len(fits.strange), 1 / len(fits.strange))
    weight = np.concatenate([fits.weight / fits.weight.sum(), share])
    weights[used], bias = logistic(clues, known, weight, [SIGNS[index] for index in used])
    return weights, bias


def describe(calibration: Calibration, lessons: Lessons) -> list[str]:
    """Lines on what was learned, of each photo by what the others teach."""
    confidence, strange = out_of_fold(lessons)
    trusted = confidence >= calibration.threshold
    right = f", of which {lessons.right[trusted].mean():.1%} are right" if trusted.any() else ""
    lines = [
        f"{len(trusted)} fits, {lessons.right.mean():.1%} within 15 degrees of azimuth; trusted from a"
        f" confidence of {calibration.threshold:.3f}: {trusted.mean():.1%}{right}"
    ]
    if len(strange):
        share = (strange >= calibration.threshold).mean()
        lines.append(f"{len(strange)} fits of rolled photos, of which {share:.1%} are trusted")
    for low, high in zip(LEVELS[:-1], LEVELS[1:], strict=True):
        here = (confidence >= low) & (confidence < high)
        if here.any():
            lines.append(
                f"confidence {low:.2f} to {min(high, 1.0):.2f}: {here.sum()} fits, mean"
                f" {confidence[here].mean():.3f}, right {lessons.right[here].mean():.3f}"
            )
    return lines


def logistic(
    clues: np.ndarray, right: np.ndarray, weight: np.ndarray, signs: Sequence[int] = SIGNS
) -> tuple[np.ndarray, float]:
    """Weights (C,), of the signs given, and bias of a ridge logistic regression of right (N,) on clues."""
    mean, deviation = clues.mean(0), clues.std(0) + 1e-6
    standard, sign = (clues - mean) / deviation, np.where(right, 1.0, -1.0)

    def loss(parameters: np.ndarray) -> tuple[float, np.ndarray]:
        margin = sign * (standard @ parameters[:-1] + parameters[-1])
        pull = -sign * weight / (1 + np.exp(margin))
        gradient = np.append(standard.T @ pull + 1e-3 * weight.sum() * parameters[:-1], pull.sum())
        penalty = 0.5e-3 * weight.sum() * float(parameters[:-1] @ parameters[:-1])
        return float(weight @ np.logaddexp(0, -margin)) + penalty, gradient

    bounds = [(0.0, None) if side > 0 else (None, 0.0) for side in signs] + [(None, None)]
    found = minimize(loss, np.zeros(clues.shape[1] + 1), jac=True, method="L-BFGS-B", bounds=bounds).x
    weights = found[:-1] / deviation
    return weights, float(found[-1] - weights @ mean)


def least_threshold(confidence: np.ndarray, right: np.ndarray, weight: np.ndarray) -> float:
    """The lowest confidence from which on at least `PRECISION` of the fits are right."""
    order = np.argsort(-confidence)
    share = np.cumsum((right * weight)[order]) / np.cumsum(weight[order])
    enough = np.flatnonzero(share >= PRECISION)
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
