"""Predictions made by hand: of an upright photo that shows the object."""

import math
from dataclasses import replace

import numpy as np
import torch

from vig.recognition import Prediction
from vig.scene import EXPOSURE_L00, Latents, Symmetry, regressed_layout
from vig_train.training.targets import azimuth_labels, numbers_of

BINS = 72


def view_probabilities(azimuth: float, spread_deg: float = 4.0) -> np.ndarray:
    """Probabilities (1, BINS) round an azimuth, radians."""
    return azimuth_labels(
        torch.tensor([azimuth], dtype=torch.float32), BINS, math.radians(spread_deg)
    ).numpy()


def prediction_of(
    azimuth: np.ndarray, numbers: np.ndarray, deviation: float, mask: np.ndarray | None = None
) -> Prediction:
    """Numbers known to a `deviation`; without a mask (H, W, 3) nothing is known of any pixel."""
    count = len(azimuth)
    masks = np.full((count, 150, 150, 3), 1 / 3, np.float32) if mask is None else mask[None]
    upright, sure = np.zeros(count, np.float32), np.ones(count, np.float32)
    return Prediction(azimuth, numbers, np.full_like(numbers, deviation), masks, upright, sure)


def prediction_of_peaks(
    peaks: dict[int, float],
    modes: int = 10,
    elevation: float = 0.5,
    light: tuple[float, ...] = (EXPOSURE_L00,),
    deviation: float = 1.0,
    symmetry: Symmetry = Symmetry.NONE,
) -> Prediction:
    """Views by the bin of the circle, of a mean shape in grey; light: the first of its numbers."""
    layout, azimuth = regressed_layout(modes), np.full((1, BINS), 1e-6, np.float32)
    for number, weight in peaks.items():
        azimuth[0, number] = weight
    numbers = np.zeros((1, layout.size), np.float32)
    numbers[0, layout["elevation"]], numbers[0, layout["albedo"]] = elevation, 0.5
    numbers[0, layout["light"]][: len(light)] = light
    return prediction_of(azimuth / azimuth.sum(), numbers, deviation).fold(symmetry)


def prediction_of_latents(latents: Latents, mask: np.ndarray, off_deg: float = 0.0) -> Prediction:
    """One that is sure of latents (B = 1), but for an azimuth that is `off_deg` too large."""
    latents = Latents.from_vector(latents.to_vector().astype(np.float32))
    latents = replace(latents, azimuth=latents.azimuth + np.float32(math.radians(off_deg)))
    return prediction_of(view_probabilities(latents.azimuth[0]), numbers_of(latents), 0.3, mask)
