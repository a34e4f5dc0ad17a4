"""What is pasted over the object is hidden in the labels, and the rest stays what it was."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch

from vig.recognition.network import mirror_prediction
from vig_train.training.augmentation import Augmentation, blobs
from vig_train.training.examples import Examples

NOTHING = Augmentation(
    flip=0, reframe=0, cut_out=0, relight=0, exposure=0, balance=0, grey=0, blur=0, noise=0
)


def examples(images: torch.Tensor, visible: int = 255) -> Examples:
    """Of images (B, H, W, 3), in which the object is all or nothing."""
    count, shape = len(images), images.shape[:3]
    seen = torch.full(shape, visible, dtype=torch.uint8)
    return Examples(
        images,
        torch.arange(count) * 0.5,
        torch.zeros(count, 23),
        torch.zeros(count),
        seen,
        torch.zeros_like(seen),
    )


@pytest.fixture
def batch() -> Examples:
    """Eight photos, each of one colour, all of it the object."""
    images = torch.arange(8, dtype=torch.uint8)[:, None, None, None].expand(8, 150, 150, 3) * 30
    return examples(images.contiguous())


def test_nothing_asked_for_changes_nothing(batch: Examples) -> None:
    made = NOTHING(batch, np.random.default_rng(0))
    torch.testing.assert_close(made.images, batch.images.permute(0, 3, 1, 2) / 255, atol=1e-6, rtol=0)
    assert torch.equal(made.azimuth, batch.azimuth) and not made.roll.any() and made.present.all()
    torch.testing.assert_close(made.mask, batch.mask(), atol=1e-6, rtol=0)


def test_what_is_pasted_over_is_hidden_where_the_picture_changed(batch: Examples) -> None:
    made = replace(NOTHING, cut_out=1)(batch, np.random.default_rng(1))
    torch.testing.assert_close(made.mask.sum(1), torch.ones(8, 75, 75))
    before = batch.images.permute(0, 3, 1, 2) / 255
    changed = ((made.images - before).abs() > 1e-3).any(1)
    hidden = torch.nn.functional.interpolate(made.mask[:, 1:2], scale_factor=2)[:, 0]
    agree = ((hidden > 0.5) == changed)[:, 4:-4, 4:-4].float().mean()
    assert changed.any((1, 2)).sum() >= 6 and agree > 0.95


def test_mask_and_roll_follow_an_image_that_is_moved(batch: Examples) -> None:
    """A white bar from the middle to the right is the object: where it ends up, and how it is turned."""
    images, visible = torch.zeros_like(batch.images), torch.zeros_like(batch.visible)
    images[:, 70:80, 75:130], visible[:, 70:80, 75:130] = 255, 255
    given = replace(batch, images=images, visible=visible)
    made = replace(NOTHING, reframe=1, turn=0.4)(given, np.random.default_rng(2))
    seen = torch.nn.functional.interpolate(made.mask[:, :1], scale_factor=2)[:, 0]
    assert ((seen > 0.5) == (made.images[:, 0] > 0.5)).float().mean() > 0.99
    y, x = torch.meshgrid(torch.arange(150.0), torch.arange(150.0), indexing="ij")
    for picture, roll in zip(made.images[:, 0], made.roll, strict=True):
        bright = picture > 0.5
        points = torch.stack([x[bright], y[bright]], 1)
        direction = torch.pca_lowrank(points, 1)[2][:, 0]  # y grows downward: clockwise is positive
        assert math.atan(direction[1] / direction[0]) == pytest.approx(float(roll), abs=0.05)
    assert made.roll.std() > 0.2


def test_the_camera_changes_brightness_about_as_much_as_asked() -> None:
    grey = examples(torch.full((400, 16, 16, 3), 100, dtype=torch.uint8))
    made = replace(NOTHING, exposure=0.2)(grey, np.random.default_rng(0))
    stops = torch.log2(made.images[:, 0].mean((1, 2)) * 255 / 100) * 2.2
    assert 0.17 < stops.std() < 0.23 and stops.mean().abs() < 0.03


def test_a_batch_is_a_pure_function_of_its_generators(batch: Examples) -> None:
    def made() -> torch.Tensor:
        torch.manual_seed(3)
        return Augmentation()(batch, np.random.default_rng(3)).images

    assert torch.equal(made(), made())


def test_blobs_are_of_many_sizes_and_neither_nothing_nor_all() -> None:
    shares = blobs(200, 60, 60, np.random.default_rng(0)).mean((1, 2))
    assert shares.min() > 0 and shares.max() < 0.6 and shares.std() > 0.03


def test_a_flip_turns_picture_mask_roll_and_targets(batch: Examples) -> None:
    visible, hidden, images = batch.visible.clone(), batch.hidden.clone(), batch.images.clone()
    visible[:, :, :38], hidden[:, :, :38] = 0, 255  # what is at the left is hidden
    images[:, :, 100:] = 255
    roll = torch.full((8,), 0.2)
    given = replace(
        batch, visible=visible, hidden=hidden, images=images, numbers=torch.ones(8, 23), roll=roll
    )
    before = NOTHING(given, np.random.default_rng(0))
    after = replace(NOTHING, flip=1)(given, np.random.default_rng(0))
    torch.testing.assert_close(after.images, before.images.flip(3), atol=1e-5, rtol=0)
    torch.testing.assert_close(after.mask, before.mask.flip(3), atol=1e-5, rtol=0)
    azimuth, numbers = map(torch.from_numpy, mirror_prediction(given.azimuth.numpy(), given.numbers.numpy()))
    assert torch.equal(after.azimuth, azimuth) and torch.equal(after.numbers, numbers)
    torch.testing.assert_close(after.roll, -roll)
