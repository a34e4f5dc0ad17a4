"""Values of the training losses, by hand."""

from __future__ import annotations

import math

import pytest
import torch

from vig.recognition.network import Heads
from vig.recognition.training import Schedule, losses, total


def heads(mask: torch.Tensor) -> Heads:
    """Of two images: nothing said of azimuth; numbers 1 and 3 with a variance of 4."""
    mean = torch.tensor([[1.0, 3.0]]).expand(2, -1)
    return Heads(torch.zeros(2, 72), mean, torch.full((2, 2), math.log(4.0)), mask)


def test_losses_by_hand() -> None:
    """Azimuth: cross-entropy of a uniform distribution over 72 bins. Numbers are off by 1 and by 3:
    (1 / 4 + log 4) and (9 / 4 + log 4), times the deviation 2. Mask: log 3 at each cell.
    """
    shares = torch.zeros(2, 3, 4, 4)
    shares[:, 1] = 1.0
    found = losses(heads(torch.zeros(2, 3, 4, 4)), torch.tensor([0.5, 4.0]), torch.zeros(2, 2), shares)
    assert float(found["azimuth"]) == pytest.approx(math.log(72), rel=1e-5)
    assert float(found["numbers"]) == pytest.approx(2 * (10 / 4 / 2 + math.log(4)), rel=1e-5)
    assert float(found["mask"]) == pytest.approx(math.log(3), rel=1e-5)


def test_an_image_without_a_mask_counts_for_nothing_in_the_masks_loss() -> None:
    """The first is said to be background, two to one in log odds of 2, and is; of the second nobody knows."""
    shares = torch.full((2, 3, 4, 4), -1.0)
    shares[0] = 0.0
    shares[0, 2] = 1.0
    logits = torch.zeros(2, 3, 4, 4)
    logits[0, 2], logits[1, 0] = 2.0, 9.0
    found = losses(heads(logits), torch.zeros(2), torch.zeros(2, 2), shares)
    assert float(found["mask"]) == pytest.approx(math.log(math.exp(2) + 2) - 2, rel=1e-5)


def test_numbers_and_mask_weigh_twice_what_azimuth_does() -> None:
    parts = {"azimuth": torch.tensor(1.0), "numbers": torch.tensor(10.0), "mask": torch.tensor(100.0)}
    assert float(total(parts)) == 1 + 20 + 200


def test_the_learning_rate_rises_for_a_twentieth_and_falls_to_a_hundredth() -> None:
    rate = Schedule(2.0, 100)
    assert [rate(step) for step in range(5)] == pytest.approx([0.4, 0.8, 1.2, 1.6, 2.0])
    assert rate(5) == pytest.approx(2.0) and rate(100) == pytest.approx(0.02)
    assert (rate(24) + rate(81)) / 2 == pytest.approx(1.01), "half a cosine is odd about its middle"
