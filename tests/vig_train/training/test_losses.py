"""Values of the training losses, by hand."""

import math
from dataclasses import replace

import pytest
import torch

from vig.scene import Symmetry
from vig_train.network.network import Heads
from vig_train.training.augmentation import Batch
from vig_train.training.loop import Schedule
from vig_train.training.losses import losses


def heads(mask: torch.Tensor) -> Heads:
    """Of two images: nothing said of azimuth or presence; numbers 1 and 3 with a variance of 4; level."""
    mean = torch.tensor([[1.0, 3.0]]).expand(2, -1)
    zero = torch.zeros(2)
    return Heads(torch.zeros(2, 72), mean, torch.full((2, 2), math.log(4.0)), zero, zero, mask)


def batch(mask: torch.Tensor, roll: float = 0.0, present: tuple[float, float] = (1.0, 1.0)) -> Batch:
    """What the images are: at azimuths 0.5 and 4, all numbers 0."""
    images, azimuth = torch.zeros(2, 3, 8, 8), torch.tensor([0.5, 4.0])
    there = torch.tensor(present)
    return Batch(azimuth, torch.zeros(2, 2), torch.full((2,), roll), there, images, mask)


def test_losses_by_hand() -> None:
    """Azimuth: cross-entropy of a uniform distribution over 72 bins. Numbers are off by 1 and by 3:
    (1 / 4 + log 4) and (9 / 4 + log 4), times the deviation 2. Mask: log 3 at each cell. Roll is off by two
    units of 10 degrees: 2 - 1 / 2 by the smooth absolute loss. Presence: log 2.
    """
    shares = torch.zeros(2, 3, 4, 4)
    shares[:, 1] = 1.0
    found = losses(heads(torch.zeros(2, 3, 4, 4)), batch(shares, roll=math.radians(20)))
    assert float(found["azimuth"]) == pytest.approx(math.log(72), rel=1e-5)
    assert float(found["numbers"]) == pytest.approx(2 * (10 / 4 / 2 + math.log(4)), rel=1e-5)
    assert float(found["mask"]) == pytest.approx(math.log(3), rel=1e-5)
    assert float(found["roll"]) == pytest.approx(1.5, rel=1e-5)
    assert float(found["presence"]) == pytest.approx(math.log(2), rel=1e-5)


def test_an_image_without_the_object_counts_for_its_mask_and_absence_only() -> None:
    shares = torch.zeros(2, 3, 4, 4)
    shares[:, 2] = 1.0
    made = heads(torch.zeros(2, 3, 4, 4))
    sure = replace(
        made, azimuth=torch.stack([torch.zeros(72), torch.arange(72.0)]), roll=torch.tensor([0.0, 3.0])
    )
    found = losses(sure, batch(shares, present=(1.0, 0.0)))
    assert float(found["azimuth"]) == pytest.approx(math.log(72), rel=1e-5)
    assert float(found["roll"]) == 0 and float(found["mask"]) == pytest.approx(math.log(3), rel=1e-5)


def test_cells_about_the_object_weigh_three_times_as_much() -> None:
    """One cell of 24 x 24 is the object; the 9 x 9 about it weigh 3. Background is said for certain: the loss
    is that of the one cell, 20 nats by the logits, over 81 x 3 + 495."""
    shares = torch.zeros(2, 3, 24, 24)
    shares[:, 2] = 1.0
    shares[:, :, 12, 12] = torch.tensor([1.0, 0.0, 0.0])
    logits = torch.zeros(2, 3, 24, 24)
    logits[:, 2] = 20.0
    found = losses(heads(logits), batch(shares))
    assert float(found["mask"]) == pytest.approx(20 * 3 / (81 * 3 + 495), rel=1e-4)


def test_the_learning_rate_rises_for_a_twentieth_and_falls_to_a_hundredth() -> None:
    rate = Schedule(2.0, 100)
    assert [rate(step) for step in range(5)] == pytest.approx([0.4, 0.8, 1.2, 1.6, 2.0])
    assert rate(5) == pytest.approx(2.0) and rate(100) == pytest.approx(0.02)
    assert (rate(24) + rate(81)) / 2 == pytest.approx(1.01), "half a cosine is odd about its middle"


def test_azimuth_does_not_count_where_any_turn_looks_the_same() -> None:
    shares = torch.full((2, 3, 4, 4), 1 / 3)
    said = replace(heads(torch.zeros(2, 3, 4, 4)), azimuth=torch.randn(2, 72))
    given = batch(shares)
    assert losses(said, given)["azimuth"] > 0
    assert losses(said, given, Symmetry.ANY_TURN)["azimuth"] == 0
    opposite = replace(said, azimuth=said.azimuth.roll(36, 1))
    half = [losses(each, given, Symmetry.HALF_TURN)["azimuth"] for each in (said, opposite)]
    torch.testing.assert_close(*half)
