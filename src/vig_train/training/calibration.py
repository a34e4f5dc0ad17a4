"""Calibration of a network's stated uncertainties on scenes and designs that training never saw."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch.nn import functional

from vig.inference.calibration import WITHIN_90
from vig.io.checks import read_tensors
from vig.io.errors import UserError
from vig.recognition.network import NetworkCalibration
from vig.recognition.recognizer import Recognizer
from vig.scene import ObjectClass
from vig_train.network.weights import as_tensors, save_tensors
from vig_train.training.examples import Examples
from vig_world.dataset import Dataset

MIN_IMAGES = 50  # fewest images on which a network is calibrated: 90 % quantiles of fewer are too uncertain


@dataclass(frozen=True)
class CalibrationResult:
    """Outputs of a network on N images before its calibration, and the calibration learned on them.

    Attributes:
        calibration: Calibration written into the weights.
        azimuth: (N,) true azimuths, radians; those of half turns twice over, so that they fill the circle.
        azimuth_logits: (N, bins) of the network, with bins that look the same joined.
        standard_errors: (N, M) errors of the regressed numbers over their stated deviations.
    """

    calibration: NetworkCalibration
    azimuth: torch.Tensor
    azimuth_logits: torch.Tensor
    standard_errors: torch.Tensor


def check_count(images: int) -> None:
    """Refuse fewer than `MIN_IMAGES`."""
    if images < MIN_IMAGES:
        raise UserError(
            f"expected at least {MIN_IMAGES} images of the object to calibrate on; got {images}. Take a"
            " larger dataset, or more photos of the studio (--studio)."
        )


def calibrate_network(
    path: Path,
    datasets: Sequence[Dataset],
    further: Sequence[Examples] = (),
    object_class: ObjectClass | None = None,
) -> CalibrationResult:
    """Write a calibration on datasets, and on further examples, into the weights at `path`.

    `object_class` has the symmetries of their objects; without it they are a teapot's.

    Raises:
        UserError: Fewer than `MIN_IMAGES`, or weights that cannot be read or are of the paper's networks.
    """
    check_count(sum(map(len, datasets)) + sum(map(len, further)))
    recognizer = Recognizer(path) if object_class is None else Recognizer.of_class(object_class, path)
    result = learn_calibration([(recognizer, Examples.concatenate([*map(Examples.of, datasets), *further]))])
    write_calibration(path, result.calibration)
    return result


def learn_calibration(parts: Sequence[tuple[Recognizer, Examples]]) -> CalibrationResult:
    """Return a calibration of networks of one class, each on examples that it has not seen."""
    symmetry = parts[0][0].symmetry
    examples = Examples.concatenate([part for _, part in parts])
    outputs = zip(*(_network_outputs(*part) for part in parts), strict=True)
    azimuth, mean, deviation, mask = map(torch.cat, outputs)
    fold = symmetry.fold
    azimuth = azimuth.unflatten(1, (max(fold, 1), -1)).logsumexp(1)
    true_azimuth = examples.azimuth if fold == 1 else torch.remainder(fold * examples.azimuth, 2 * math.pi)
    labels = functional.one_hot(azimuth_bins(true_azimuth, azimuth.shape[1]), azimuth.shape[1]).float()
    error = mean - examples.numbers
    cell_stride = 29  # one in so many cells of the mask is used: neighbours are nearly the same
    cell_logits = mask.movedim(1, -1).reshape(-1, mask.shape[1])[::cell_stride]
    cell_labels = examples.mask().movedim(1, -1).reshape(-1, mask.shape[1])[::cell_stride]
    calibration = NetworkCalibration(
        (fit_temperature(azimuth, labels) if fold else torch.ones(())).numpy(),
        fit_temperature(cell_logits, cell_labels).numpy(),
        deviation_factors(error, deviation).numpy(),
    )
    return CalibrationResult(calibration, true_azimuth, azimuth, error / deviation)


def write_calibration(path: Path, calibration: NetworkCalibration) -> None:
    """Put a calibration into a weights file, in place of its own."""
    stored, metadata = read_tensors(path, "pt")
    tensors = {name: value for name, value in stored.items() if not name.startswith(calibration.PREFIX)}
    save_tensors(path, tensors | as_tensors(calibration.tensors()), metadata)


@torch.inference_mode()
def _network_outputs(recognizer: Recognizer, examples: Examples) -> tuple[torch.Tensor, ...]:
    """Return azimuth logits, numbers, their stated deviations, and mask logits, all uncalibrated."""
    outputs = []
    for indices in torch.arange(len(examples)).split(64):
        heads = recognizer.heads(examples[indices].pixels().numpy())
        numbers = heads.mean * recognizer.deviation + recognizer.mean
        deviation = np.exp(0.5 * heads.log_variance) * recognizer.deviation
        outputs.append((heads.azimuth, numbers, deviation, heads.mask))
    return tuple(torch.from_numpy(np.concatenate(column)) for column in zip(*outputs, strict=True))


def azimuth_bins(azimuth: torch.Tensor, bins: int) -> torch.Tensor:
    """Return the bin (N,) that each azimuth (N,) in [0, 2 pi) lies in."""
    return (azimuth * bins / (2 * math.pi)).long().clamp(0, bins - 1)


def fit_temperature(logits: torch.Tensor, labels: torch.Tensor) -> torch.Tensor:
    """Return the temperature () under which logits (N, C) give soft labels (N, C) the greatest likelihood."""
    temperatures = torch.logspace(-0.5, 0.7, 121)
    losses = [functional.cross_entropy(logits / t, labels) for t in temperatures]
    return temperatures[int(torch.stack(losses).argmin())]


def deviation_factors(error: torch.Tensor, deviation: torch.Tensor) -> torch.Tensor:
    """Return factors (M,) of deviations (N, M) after which 90 % of errors (N, M) lie within 90 % intervals.

    At least 0.5: a number that hardly varies, as L00 at a set exposure, is not known infinitely well.
    """
    return (torch.quantile(error.abs() / deviation, 0.9, dim=0) / WITHIN_90).clamp_min(0.5)
