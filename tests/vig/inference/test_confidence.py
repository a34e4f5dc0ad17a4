"""A fit that a small roll would better, and one that it would not."""

from __future__ import annotations

import math

import pytest
import torch

from vig.inference.confidence import ROLL, roll_gain
from vig.likelihood import ROBUST


def bar(angle: float, height: int = 80, width: int = 100) -> torch.Tensor:
    """Coverage (H, W) of a long bar through the image's centre, turned by angle."""
    y, x = torch.meshgrid(
        torch.arange(height) + 0.5 - height / 2, torch.arange(width) + 0.5 - width / 2, indexing="ij"
    )
    along = x * math.cos(angle) + y * math.sin(angle)
    across = y * math.cos(angle) - x * math.sin(angle)
    return ((along.abs() < 30) & (across.abs() < 6)).float()


def gain(photo_angle: float, fit_angle: float) -> float:
    seen, covered = bar(photo_angle), bar(fit_angle)
    observed = 0.1 + 0.5 * seen[..., None].expand(-1, -1, 3)
    rendered = torch.full_like(observed, 0.6)
    log_prior = ROBUST.log_prior(*seen.shape).float()
    return roll_gain(rendered, covered, observed, log_prior, int((seen * covered).sum()))


@pytest.mark.parametrize("sign", [-1, 1])
def test_a_fit_of_a_rolled_object_gains_by_a_roll_either_way(sign: int) -> None:
    assert gain(sign * ROLL, 0.0) > 0.3
    assert gain(sign * 2 * ROLL, 0.0) > 0.05


def test_a_level_fit_loses() -> None:
    assert gain(0.0, 0.0) < -0.3


def test_a_fit_that_sees_nothing_says_nothing() -> None:
    empty = torch.zeros(80, 100)
    photo = torch.full((80, 100, 3), 0.5)
    assert roll_gain(photo, empty, photo, ROBUST.log_prior(80, 100).float(), 0) == 0
