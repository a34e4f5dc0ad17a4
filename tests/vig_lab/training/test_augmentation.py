"""What is pasted over the object is hidden in the labels, and the rest stays what it was."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from vig_lab.training.augmentation import NO_MASK, Augmentation, blobs
from vig_lab.training.examples import Examples
from vig_lab.training.targets import mirrored

NOTHING = Augmentation(0, 0, 0, 0, 0, 0, 0, 0.9, 0)


@pytest.fixture
def batch() -> Examples:
    """Eight photos, each of one colour, all of it the object."""
    images = torch.arange(8, dtype=torch.uint8)[:, None, None, None].expand(8, 150, 150, 3) * 30
    mask = torch.zeros(8, 3, 38, 38, dtype=torch.uint8)
    mask[:, 0] = 255
    return Examples(images.contiguous(), torch.arange(8) * 0.5, torch.zeros(8, 23), mask)


def test_nothing_asked_for_changes_nothing(batch: Examples) -> None:
    images, azimuth, _, mask = NOTHING(batch, np.random.default_rng(0))
    torch.testing.assert_close(images, batch.images.permute(0, 3, 1, 2) / 255, atol=1e-6, rtol=0)
    assert torch.equal(azimuth, batch.azimuth) and torch.equal(mask, batch.mask / 255)


def test_what_is_pasted_over_is_hidden_where_the_picture_changed(batch: Examples) -> None:
    images, _, _, mask = Augmentation(0, 0, 1, 0, 0, 0, 0, 0.9, 0)(batch, np.random.default_rng(1))
    torch.testing.assert_close(mask.sum(1), torch.ones(8, 38, 38))
    changed = (images != batch.images.permute(0, 3, 1, 2) / 255).any(1)
    hidden = torch.nn.functional.interpolate(mask[:, 1:2], scale_factor=4)[:, 0, 2:152, 2:152]
    agree = ((hidden > 0.5) == changed)[:, 4:-4, 4:-4].float().mean()
    assert changed.any((1, 2)).sum() >= 6 and agree > 0.95


def test_an_image_that_was_moved_has_no_mask(batch: Examples) -> None:
    _, _, _, mask = Augmentation(0, 1, 0, 0, 0, 0, 0, 0.9, 0)(batch, np.random.default_rng(0))
    assert (mask == NO_MASK).all()


def test_the_camera_changes_brightness_about_as_much_as_asked() -> None:
    grey = Examples(
        torch.full((400, 16, 16, 3), 100, dtype=torch.uint8),
        torch.zeros(400),
        torch.zeros(400, 23),
        torch.zeros(400, 3, 4, 4, dtype=torch.uint8),
    )
    images, *_ = Augmentation(0, 0, 0, 0, 0.2, 0, 0, 0.9, 0)(grey, np.random.default_rng(0))
    stops = torch.log2(images[:, 0].mean((1, 2)) * 255 / 100) * 2.2
    assert 0.17 < stops.std() < 0.23 and stops.mean().abs() < 0.03


def test_a_batch_is_a_pure_function_of_its_generators(batch: Examples) -> None:
    def made() -> torch.Tensor:
        torch.manual_seed(3)
        return Augmentation()(batch, np.random.default_rng(3))[0]

    assert torch.equal(made(), made())


def test_blobs_are_of_many_sizes_and_neither_nothing_nor_all() -> None:
    shares = blobs(200, 60, 60, np.random.default_rng(0)).mean((1, 2))
    assert shares.min() > 0 and shares.max() < 0.6 and shares.std() > 0.03


def test_a_flip_turns_picture_mask_and_targets(batch: Examples) -> None:
    mask, images = batch.mask.clone(), batch.images.clone()
    mask[:, 0, :, :19], mask[:, 1, :, :19] = 0, 255  # what is at the left is hidden
    images[:, :, 100:] = 255
    given = replace(batch, mask=mask, images=images, numbers=torch.ones(8, 23))
    before = NOTHING(given, np.random.default_rng(0))
    after = replace(NOTHING, flip=1)(given, np.random.default_rng(0))
    torch.testing.assert_close(after[0], before[0].flip(3), atol=1e-6, rtol=0)
    assert torch.equal(after[3], before[3].flip(3))
    azimuth, numbers = mirrored(given.azimuth, given.numbers)
    assert torch.equal(after[1], azimuth) and torch.equal(after[2], numbers)
