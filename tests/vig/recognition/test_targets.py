"""Targets of the recognition network."""

import math

import numpy as np
import torch

from vig.recognition.targets import (
    azimuth_labels,
    latents_of,
    mask_at_pixels,
    mask_labels,
    mirrored,
    numbers_of,
)
from vig.scene import Latents


def some_latents(count: int = 5) -> Latents:
    rng = np.random.default_rng(3)
    light = rng.normal(0, 0.5, (count, 9))
    light[:, 0] = 2.356
    columns = [
        rng.normal(size=(count, 10)).clip(-3, 3),
        rng.uniform(0, 6.28, count),
        rng.uniform(0.1, 1.4, count),
        rng.uniform(0.2, 0.8, (count, 3)),
        light,
    ]
    return Latents(*(torch.from_numpy(column).float() for column in columns))


def test_numbers_and_latents_are_inverse():
    latents = some_latents()
    back = latents_of(numbers_of(latents), latents.azimuth)
    assert torch.allclose(back.to_vector(), latents.to_vector(), atol=1e-5)


def test_azimuth_labels_peak_at_the_azimuth_and_wrap():
    labels = azimuth_labels(torch.tensor([0.0, math.radians(47.4)]), 72)
    assert torch.allclose(labels.sum(1), torch.ones(2))
    assert torch.allclose(labels[0, 0], labels[0, -1])  # 0 lies between the first bin and the last
    assert labels[1].argmax() == 9  # bin 9 is 45 to 50 degrees


def test_mirroring_twice_changes_nothing():
    latents = some_latents()
    azimuth, numbers = mirrored(*mirrored(latents.azimuth, numbers_of(latents)))
    assert torch.allclose(torch.cos(azimuth), torch.cos(latents.azimuth), atol=1e-5)
    assert torch.allclose(numbers, numbers_of(latents))


def test_mask_labels_and_pixels_use_the_same_grid():
    amodal = torch.zeros(1, 150, 150, dtype=torch.bool)
    amodal[:, 40:110, 30:120] = True
    visible = amodal.clone()
    visible[:, :, :70] = False
    labels = mask_labels(amodal, visible)
    assert labels.shape == (1, 3, 38, 38)
    assert torch.allclose(labels.sum(1), torch.ones(1, 38, 38))
    pixels = mask_at_pixels(torch.log(labels + 1e-4), 150, 150)[0]
    truth = torch.stack([visible, amodal & ~visible, ~amodal], -1)[0]
    assert (pixels.argmax(-1) == truth.int().argmax(-1)).float().mean() > 0.97
