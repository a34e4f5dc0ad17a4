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
from scipy.optimize import minimize

from vig.dataset import Dataset
from vig.evaluation.fits import Fits, fit_all, key_of
from vig.inference import Calibration, ExplainSettings
from vig.inference.calibration import CLUES, residual
from vig.recognition import Recognizer
from vig.scene import ObjectClass, linear_from_srgb

RIGHT = math.radians(15.0)
"""A view is right within this."""
PRECISION = 0.98
"""Of trusted fits, at least this share is to be right; 0.95 is what is promised."""
WITHIN_90 = 1.6449
SIGNS = tuple(-1 if clue in ("hidden", "misfit", "height") else 1 for clue in CLUES)
"""Which way each clue may speak: trust must not grow with a worse fit, whatever a sample of photos says."""
LEVELS = (0.0, 0.5, 0.7, 0.8, 0.9, 0.95, 0.98, 1.01)
LEAST = 40
"""Fits below which a group is not told apart from all."""


@dataclass(frozen=True)
class Lessons:
    """Fits of validation photos: clues (N, C), right (N,) bool, errors and deviations (N, P), weight (N,)."""

    clues: np.ndarray
    right: np.ndarray
    error: np.ndarray
    deviation: np.ndarray
    weight: np.ndarray


def calibrate_fits(
    datasets: Sequence[Dataset],
    object_class: ObjectClass,
    recognizer: Recognizer,
    settings: ExplainSettings | None = None,
    threads: int | None = None,
    advance: Callable[[int], None] = lambda done: None,
    cache: Path | None = None,
) -> tuple[Calibration, Lessons]:
    """Fit all photos of datasets, each of which counts alike whatever its size, and learn from them.

    cache: keeps the fits, see `fit_all`.
    """
    plain = replace(settings or ExplainSettings(), calibrated=False)
    parts = []
    for dataset in datasets:
        photos = torch.from_numpy(linear_from_srgb(dataset.images.astype(np.float32) / 255)).float()
        folder = (
            None if cache is None else cache / f"{len(dataset)}_{zlib.crc32(dataset.latents.tobytes()):08x}"
        )
        fits = fit_all(
            dataset.images,
            photos,
            recognizer(photos),
            object_class,
            plain,
            threads or os.cpu_count() or 1,
            advance,
            folder,
            key_of(recognizer, object_class, plain),
        )
        parts.append(lessons_of(fits, dataset))
    lessons = Lessons(
        *(np.concatenate(c) for c in zip(*[tuple(vars(p).values()) for p in parts], strict=True))
    )
    return learn(lessons), lessons


def lessons_of(fits: Fits, dataset: Dataset) -> Lessons:
    """What fits of a whole dataset, not calibrated, teach."""
    error = fits.latents.astype(np.float64) - dataset.latents
    azimuth = error.shape[1] - 14
    error[:, azimuth] = (error[:, azimuth] + np.pi) % (2 * np.pi) - np.pi
    right = np.abs(error[:, azimuth]) < RIGHT
    return Lessons(
        fits.clues, right, error, fits.deviation.astype(np.float64), np.full(len(right), 1 / len(right))
    )


def learn(fits: Lessons) -> Calibration:
    """The calibration that holds on fits; the threshold is chosen out of sample, by five folds."""
    weights, bias = logistic(fits.clues, fits.right, fits.weight)
    folds = np.arange(len(fits.right)) % 5
    confidence = np.empty(len(folds))
    for fold in range(5):
        away = folds != fold
        w, b = logistic(fits.clues[away], fits.right[away], fits.weight[away])
        confidence[~away] = 1 / (1 + np.exp(-(fits.clues[~away] @ w) - b))
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
        torch.from_numpy(weights), bias, threshold, torch.from_numpy(scale), torch.from_numpy(floor)
    )


def describe(calibration: Calibration, lessons: Lessons) -> list[str]:
    """Lines on what was learned."""
    clues = torch.from_numpy(lessons.clues)
    confidence = np.array([calibration.confidence(each) for each in clues])
    trusted = confidence >= calibration.threshold
    right = f", of which {lessons.right[trusted].mean():.1%} are right" if trusted.any() else ""
    lines = [
        f"{len(trusted)} fits, {lessons.right.mean():.1%} within 15 degrees of azimuth; trusted from a"
        f" confidence of {calibration.threshold:.3f}: {trusted.mean():.1%}{right}"
    ]
    for low, high in zip(LEVELS[:-1], LEVELS[1:], strict=True):
        here = (confidence >= low) & (confidence < high)
        if here.any():
            lines.append(
                f"confidence {low:.2f} to {min(high, 1.0):.2f}: {here.sum()} fits, mean"
                f" {confidence[here].mean():.3f}, right {lessons.right[here].mean():.3f}"
            )
    return lines


def logistic(clues: np.ndarray, right: np.ndarray, weight: np.ndarray) -> tuple[np.ndarray, float]:
    """Weights (C,), of the signs `SIGNS`, and bias of a ridge logistic regression of right (N,) on clues."""
    mean, deviation = clues.mean(0), clues.std(0) + 1e-6
    standard, sign = (clues - mean) / deviation, np.where(right, 1.0, -1.0)

    def loss(parameters: np.ndarray) -> tuple[float, np.ndarray]:
        margin = sign * (standard @ parameters[:-1] + parameters[-1])
        pull = -sign * weight / (1 + np.exp(margin))
        gradient = np.append(standard.T @ pull + 1e-3 * weight.sum() * parameters[:-1], pull.sum())
        penalty = 0.5e-3 * weight.sum() * float(parameters[:-1] @ parameters[:-1])
        return float(weight @ np.logaddexp(0, -margin)) + penalty, gradient

    bounds = [(0.0, None) if side > 0 else (None, 0.0) for side in SIGNS] + [(None, None)]
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
        floor = float(np.quantile(needed, level)) if level else 0.0
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
