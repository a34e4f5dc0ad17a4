"""What the network is trained for: a distribution over azimuth, likelihoods of numbers, a mask."""

from __future__ import annotations

import torch
from torch.nn import functional

from vig.recognition.network import Heads
from vig.recognition.targets import azimuth_labels

PARTS = ("azimuth", "numbers", "mask")
WEIGHTS = {"azimuth": 1.0, "numbers": 2.0, "mask": 2.0}


def losses(
    heads: Heads, azimuth: torch.Tensor, numbers: torch.Tensor, mask: torch.Tensor
) -> dict[str, torch.Tensor]:
    """Each part's loss: azimuth (B,) radians; numbers (B, M) in the heads' units; mask shares (B, 3, h, w).

    Images whose mask is negative have none. Numbers have a Gaussian likelihood, each term weighted by its
    own deviation (beta-NLL, Seitzer et al. 2022), so that those that are hard to tell go on being learned.
    """
    labels = azimuth_labels(azimuth, heads.azimuth.shape[1])
    variance = heads.log_variance.exp()
    likelihood = (heads.mean - numbers) ** 2 / variance + heads.log_variance
    known = (mask.amin((1, 2, 3)) >= 0).float()
    pixels = functional.cross_entropy(heads.mask, mask.clamp_min(0.0), reduction="none").mean((1, 2))
    return {
        "azimuth": functional.cross_entropy(heads.azimuth, labels),
        "numbers": (likelihood * variance.detach().sqrt()).mean(),
        "mask": (pixels * known).sum() / known.sum().clamp_min(1.0),
    }


def total(parts: dict[str, torch.Tensor]) -> torch.Tensor:
    """The weighted sum that is minimised."""
    return sum((WEIGHTS[name] * loss for name, loss in parts.items()), torch.zeros(()))
