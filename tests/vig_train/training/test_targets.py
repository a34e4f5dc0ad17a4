"""Targets of the recognition network."""

import math

import numpy as np
import torch

from vig.recognition.network import latents_of, mask_at_pixels, mirror_prediction
from vig.scene import Latents, Symmetry
from vig_train.training.targets import azimuth_labels, cell_shares, numbers_of


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


def flipped(azimuth: torch.Tensor, numbers: torch.Tensor) -> tuple[torch.Tensor, ...]:
    return tuple(map(torch.from_numpy, mirror_prediction(*map(np.asarray, (azimuth, numbers)))))


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
    azimuth, numbers = flipped(*flipped(latents.azimuth, numbers_of(latents)))
    assert torch.allclose(torch.cos(azimuth), torch.cos(latents.azimuth), atol=1e-5)
    assert torch.allclose(numbers, numbers_of(latents))


def test_mirroring_moves_the_eye_across_the_plane_of_symmetry_and_light_to_the_other_hand():
    """An eye at azimuth a stands towards (sin a, -cos a); mirrored in y = 0, towards (sin a, cos a), which is
    azimuth pi - a. In the heading frame the photo's x changes sign, and with it Y_11 ~ x, Y_2-2 ~ xy and
    Y_21 ~ xz, the fourth, fifth and eighth of nine coefficients; elevation, shape and albedo stay.
    """
    numbers = torch.arange(1.0, 24.0)[None].expand(3, -1)  # elevation, 10 of shape, 3 of albedo, 9 of light
    degrees = torch.tensor([30.0, 90.0, 200.0])
    azimuth, other = flipped(torch.deg2rad(degrees), numbers)
    torch.testing.assert_close(torch.rad2deg(azimuth), torch.tensor([150.0, 90.0, 340.0]))
    sign = torch.tensor([1.0] * 14 + [1, 1, 1, -1, -1, 1, 1, -1, 1])
    assert torch.equal(other, numbers * sign)


def test_a_mirrored_target_is_the_target_of_the_mirrored_picture(studio):
    """The teapot is its own mirror image in y = 0, and so are its shape components."""
    latents = studio.latents(np.random.default_rng(5), 3)
    azimuth, numbers = mirror_prediction(latents.azimuth, numbers_of(latents))
    *_, picture = studio.render(latents)
    *_, other = studio.render(latents_of(numbers, azimuth))
    off = np.abs(picture[:, :, ::-1] - other).mean((1, 2, 3))
    assert (off < 1e-6 * picture.mean((1, 2, 3))).all(), off / picture.mean((1, 2, 3))


def test_cells_and_pixels_use_the_same_grid():
    amodal = torch.zeros(1, 150, 150, dtype=torch.bool)
    amodal[:, 41:110, 31:120] = True
    visible = amodal.clone()
    visible[:, :, :70] = False
    shares = cell_shares(visible.float(), (amodal & ~visible).float())
    assert shares.shape == (1, 3, 75, 75)
    assert torch.allclose(shares.sum(1), torch.ones(1, 75, 75))
    assert shares[0, :, 20, 15].tolist() == [0, 0.25, 0.75], "one pixel of four is the object's corner"
    pixels = torch.from_numpy(mask_at_pixels(torch.log(shares + 1e-4).numpy(), 150, 150))[0]
    truth = torch.stack([visible, amodal & ~visible, ~amodal], -1)[0]
    assert (pixels.argmax(-1) == truth.int().argmax(-1)).float().mean() > 0.99


def test_labels_of_half_turns_have_two_equal_peaks():
    azimuth = torch.tensor([0.3, 6.1])
    one = azimuth_labels(azimuth, 72)
    two = azimuth_labels(azimuth, 72, symmetry=Symmetry.HALF_TURN)
    torch.testing.assert_close(two, (one + one.roll(36, 1)) / 2)
    any_turn = azimuth_labels(azimuth, 72, symmetry=Symmetry.ANY_TURN)
    torch.testing.assert_close(any_turn, torch.full((2, 72), 1 / 72))
