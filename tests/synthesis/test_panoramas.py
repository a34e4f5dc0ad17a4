"""Panoramas: layout, determinism, and light statistics that span what real indoor panoramas show."""

import numpy as np
import pytest

from vig.scene import EXPOSURE_L00
from vig.synthesis.panoramas import directions, grey_light, panorama


@pytest.fixture(scope="module")
def lights() -> np.ndarray:
    return np.stack([grey_light(panorama(np.random.default_rng(seed), 32)) for seed in range(200)])


def test_is_finite_hdr_of_the_asked_size():
    for seed in range(10):
        image = panorama(np.random.default_rng(seed), 32)
        assert image.shape == (32, 64, 3) and image.dtype == np.float32
        assert np.isfinite(image).all() and image.min() >= 0
        assert image.max() > 2 * image.mean()


def test_same_seed_same_bytes_other_seed_other_room():
    a, b, c = (panorama(np.random.default_rng(seed)) for seed in (4, 4, 5))
    assert a.tobytes() == b.tobytes()
    assert a.tobytes() != c.tobytes()


def test_directions_run_down_from_up_and_counter_clockwise_from_x():
    way = directions(64)
    assert np.allclose(np.linalg.norm(way, axis=-1), 1, atol=1e-6)
    assert (way[0, :, 2] > 0.99).all() and (way[-1, :, 2] < -0.99).all()
    middle = way[32]
    assert middle[0, 0] > 0.99 and middle[32, 1] > 0.99 and middle[64, 0] < -0.99


def test_grey_light_is_exposed(lights):
    assert lights.shape == (200, 9)
    assert np.allclose(lights[:, 0], EXPOSURE_L00)


def test_light_statistics_span_real_indoor_ones(lights):
    """Of 26 real ones, over L0 (min, median, max): |L1| .24 .82 1.46, |L2| .18 .62 1.78, up -.11 .44 1.16."""
    ratio = lights / lights[:, :1]
    first, second = np.linalg.norm(ratio[:, 1:4], axis=1), np.linalg.norm(ratio[:, 4:], axis=1)
    for value, low, middle, high in (
        (first, 0.4, 0.82, 1.15),
        (second, 0.35, 0.65, 1.2),
        (ratio[:, 2], 0.0, 0.44, 0.85),
    ):
        assert np.quantile(value, 0.03) < low
        assert abs(np.median(value) - middle) < 0.2
        assert np.quantile(value, 0.97) > high


def test_light_comes_from_all_sides(lights):
    azimuth = np.arctan2(lights[:, 1], lights[:, 3])
    counts, _ = np.histogram(azimuth, bins=4, range=(-np.pi, np.pi))
    assert counts.min() > 25


def test_statistics_do_not_depend_on_the_resolution():
    for seed in range(5):
        coarse, fine = (grey_light(panorama(np.random.default_rng(seed), h)) for h in (64, 128))
        assert np.abs(coarse - fine).max() < 0.35


def test_refuses_too_few_rows():
    with pytest.raises(ValueError, match="at least 16 rows; got 8"):
        panorama(np.random.default_rng(0), 8)
