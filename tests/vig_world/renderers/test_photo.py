from dataclasses import replace

import numpy as np
import pytest

from vig.scene import linear_from_srgb, srgb8_from_linear
from vig_world.renderers.photo import PhotoSettings, _count_photons, _through_lens, photograph

PLAIN = PhotoSettings(0.0, (1.0, 1.0, 1.0), 0.0, 0.01, 0.0, 0.0, 1e9, 0.0, 95, False)
"""A camera without faults."""
SIZE = (60, 60, 3)


def photographs_of_grey(count: int, value: float = 0.3) -> list[tuple[np.ndarray, PhotoSettings]]:
    return [photograph(np.full(SIZE, value), np.random.default_rng(seed)) for seed in range(count)]


def test_the_same_generator_gives_the_same_photograph() -> None:
    (first, how), (second, other) = (
        photograph(np.full(SIZE, 0.2), np.random.default_rng(3)) for _ in range(2)
    )
    assert np.array_equal(first, second) and how == other
    assert first.dtype == np.uint8 and first.shape == SIZE


def test_photographs_of_grey_keep_its_mean_up_to_what_the_settings_tell() -> None:
    """In the middle, where vignetting is nothing: value times 2^exposure times white balance."""
    for image, how in photographs_of_grey(20):
        middle = linear_from_srgb(image[24:36, 24:36] / 255.0).mean((0, 1))
        expected = 0.3 * 2**how.exposure * np.array(how.white_balance)
        np.testing.assert_allclose(middle, expected, rtol=0.05)


def test_settings_stay_modest_and_centre_on_a_right_exposure() -> None:
    drawn = [PhotoSettings.draw(np.random.default_rng(seed)) for seed in range(500)]
    exposures = np.array([how.exposure for how in drawn])
    balance = np.array([how.white_balance for how in drawn])
    assert np.abs(exposures).max() <= 0.6 and abs(exposures.mean()) < 0.03
    assert 0.8 < balance.min() and balance.max() < 1.25
    np.testing.assert_allclose(balance @ [0.2126, 0.7152, 0.0722], 1)
    assert 0.15 < np.mean([how.motion > 0 for how in drawn]) < 0.25


def test_noise_is_that_of_the_electrons_counted() -> None:
    """N = 0.25 x 2 x 4000 = 2000 electrons: deviation sqrt(2000 + 10^2) of 4000."""
    how = replace(PLAIN, exposure=1.0, electrons=4000.0, read_noise=10.0)
    read = _count_photons(np.full((200, 200, 3), 0.25), how, np.random.default_rng(1))
    assert read.mean() == pytest.approx(0.5, rel=1e-3)
    assert read.std() == pytest.approx(np.sqrt(2100) / 4000, rel=0.02)


def test_vignetting_is_what_is_lost_in_the_corners() -> None:
    light = _through_lens(np.ones((51, 51, 3)), replace(PLAIN, vignetting=0.2))
    assert light[25, 25, 0] == pytest.approx(1)
    assert light[0, 0, 0] == pytest.approx(0.8, abs=0.01)


def test_blur_and_motion_spread_a_point_as_far_as_they_say() -> None:
    point = np.zeros((41, 41, 3))
    point[20, 20] = 1
    columns = np.arange(41) - 20.0
    still = _through_lens(point, replace(PLAIN, blur=0.7))[..., 0]
    assert still.sum() == pytest.approx(1)
    assert (still.sum(0) @ columns**2) == pytest.approx(0.7**2, rel=0.03)
    moved = _through_lens(point, replace(PLAIN, blur=0.3, motion=4.0))[..., 0]
    assert moved.sum() == pytest.approx(1) and moved.sum(0) @ columns == pytest.approx(0, abs=1e-9)
    assert moved.sum(0) @ columns**2 > 5 * (moved.sum(1) @ columns**2)


def test_bright_lamps_clip_to_white_and_black_stays_black() -> None:
    image = photograph(np.full(SIZE, 1e6), np.random.default_rng(0))[0]
    assert image.min() > 200
    image = photograph(np.zeros(SIZE), np.random.default_rng(0))[0]
    assert image.max() < 30


@pytest.mark.parametrize("bad", [np.zeros((4, 4)), np.full((4, 4, 3), -0.1), np.full((4, 4, 3), np.inf)])
def test_what_is_not_linear_light_is_refused(bad: np.ndarray) -> None:
    with pytest.raises(ValueError, match="a picture"):
        photograph(bad, np.random.default_rng(0))


def test_a_photograph_looks_like_the_picture() -> None:
    x = np.linspace(0.05, 0.8, 60)
    picture = np.stack(np.broadcast_arrays(x[:, None], x, 0.4), -1)
    image, how = photograph(picture, np.random.default_rng(8))
    expected = srgb8_from_linear(picture * 2**how.exposure * np.array(how.white_balance))
    assert np.abs(image.astype(float) - expected)[5:-5, 5:-5].mean() < 8


def test_settings_that_are_given_are_taken() -> None:
    image, how = photograph(np.full(SIZE, 0.2), np.random.default_rng(3), replace(PLAIN, exposure=1.0))
    assert how == replace(PLAIN, exposure=1.0)
    assert np.abs(image.astype(float) - srgb8_from_linear(np.full(SIZE, 0.4))).max() <= 1
