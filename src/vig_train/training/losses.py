"""The parts of the loss of the recognition network, and their weighted sum."""

import math

import torch
from torch.nn import functional

from vig.scene import Symmetry, angle_difference
from vig_train.network.network import DenseHeads, Heads
from vig_train.training.augmentation import Batch
from vig_train.training.targets import Targets, azimuth_labels

LOSS_WEIGHTS = {"azimuth": 1.0, "numbers": 2.0, "mask": 2.0, "roll": 1.0, "presence": 0.3}
"""Weights of the parts of the loss."""


def losses(heads: Heads, batch: Batch, symmetry: Symmetry = Symmetry.NONE) -> dict[str, torch.Tensor]:
    """Return each part of the loss: see `dense_losses` and `mask_loss`.

    Args:
        heads: The network's outputs.
        batch: Truth; its numbers are in the heads' units.
        symmetry: Symmetry of the class.
    """
    parts = dense_losses(heads, batch, symmetry)
    parts["mask"] = mask_loss(heads.mask, batch.mask)
    return {name: parts[name] for name in LOSS_WEIGHTS}


def dense_losses(
    heads: DenseHeads, targets: Targets, symmetry: Symmetry = Symmetry.NONE
) -> dict[str, torch.Tensor]:
    """Return parts of the loss of all heads but the mask: azimuth's distribution, likelihoods, others.

    Terms of numbers are weighted by their own deviations (beta-NLL, Seitzer et al. 2022), so that those that
    are hard to predict continue to be learned. Where the object is absent only presence counts.

    Args:
        heads: The network's outputs.
        targets: Truth; the numbers in the heads' units.
        symmetry: Symmetry of the class; where any turn looks the same azimuth does not count.
    """
    labels = azimuth_labels(targets.azimuth, heads.azimuth.shape[1], symmetry=symmetry)
    azimuth = functional.cross_entropy(heads.azimuth, labels, reduction="none") * float(symmetry.fold > 0)
    variance = heads.log_variance.exp()
    likelihood = (heads.mean - targets.numbers) ** 2 / variance + heads.log_variance
    weight = targets.present / targets.present.sum().clamp_min(1.0)
    # Errors of roll count in units of 10 degrees.
    roll_error = angle_difference(heads.roll, targets.roll) / math.radians(10.0)
    roll_loss = functional.smooth_l1_loss(roll_error, torch.zeros_like(roll_error), reduction="none")
    return {
        "azimuth": (azimuth * weight).sum(),
        "numbers": ((likelihood * variance.detach().sqrt()).mean(1) * weight).sum(),
        "roll": (roll_loss * weight).sum(),
        "presence": functional.binary_cross_entropy_with_logits(heads.presence, targets.present),
    }


def mask_loss(logits: torch.Tensor, shares: torch.Tensor) -> torch.Tensor:
    """Return the cross-entropy of mask logits (B, 3, h, w) with shares of the classes, of the same shape.

    Cells on and about the object count more than others, for its parts may be thin.
    """
    # Side, in cells of the mask head, of the square about each object's cell that counts as near the object.
    mask_margin_cells = 9
    near_object = functional.max_pool2d(
        1 - shares[:, 2], mask_margin_cells, stride=1, padding=mask_margin_cells // 2
    )
    # Cells on and near the object weigh three times as much as others.
    weight = 1 + 2.0 * near_object
    cell_loss = functional.cross_entropy(logits, shares, reduction="none")
    return (cell_loss * weight).sum() / weight.sum()
