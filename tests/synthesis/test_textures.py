"""Textures: range, shape, determinism, tiling."""

import numpy as np
import pytest

from vig.synthesis.textures import KINDS, colour, near, noise, texture


@pytest.mark.parametrize("kind", KINDS)
def test_is_linear_albedo_of_the_asked_size(kind):
    for seed in range(5):
        image = texture(kind, np.random.default_rng(seed), 48)
        assert image.shape == (48, 48, 3) and image.dtype == np.float32
        assert image.min() >= 0.02 and image.max() <= 0.95


@pytest.mark.parametrize("kind", KINDS)
def test_same_seed_same_bytes_other_seed_other_image(kind):
    a, b, c = (texture(kind, np.random.default_rng(seed)) for seed in (1, 1, 2))
    assert a.tobytes() == b.tobytes()
    assert a.tobytes() != c.tobytes()


@pytest.mark.parametrize("kind", ["paint", "speckle", "tiles"])
def test_base_is_the_main_colour(kind):
    base = np.float32([0.5, 0.2, 0.1])
    for seed in range(5):
        median = np.median(texture(kind, np.random.default_rng(seed), base=base), axis=(0, 1))
        assert np.allclose(median, base, rtol=0.4)


@pytest.mark.parametrize("kind", ["paint", "marble", "speckle"])
def test_smooth_kinds_tile(kind):
    """The step across the border is not larger than the steps inside."""
    image = texture(kind, np.random.default_rng(3), 64)
    inside = np.abs(np.diff(image, axis=0)).mean(axis=(1, 2))
    assert np.abs(image[0] - image[-1]).mean() <= inside.max() * 1.5


def test_noise_is_normalised_and_stretches_along_v():
    field = noise(np.random.default_rng(0), 64, 1.5, stretch=8.0)
    assert abs(field.mean()) < 1e-4 and abs(field.std() - 1) < 1e-4
    assert np.abs(np.diff(field, axis=0)).mean() < 0.5 * np.abs(np.diff(field, axis=1)).mean()


def test_colours_span_dark_bright_and_saturated():
    rng = np.random.default_rng(0)
    colours = np.array([colour(rng) for _ in range(500)])
    mean, spread = colours.mean(1), np.ptp(colours, axis=1)
    assert colours.min() >= 0.02 and colours.max() <= 0.95
    assert mean.min() < 0.1 and mean.max() > 0.8
    assert (spread < 0.05).any() and (spread > 0.5).any()


def test_near_stays_near():
    rng = np.random.default_rng(0)
    base = np.float32([0.3, 0.4, 0.5])
    shifted = np.array([near(base, rng, 0.1) for _ in range(100)])
    assert np.abs(shifted / base - 1).max() <= 0.15 + 1e-6


def test_refuses_unknown_kinds_and_tiny_sizes():
    with pytest.raises(ValueError, match="kind must be one of paint, wood"):
        texture("velvet", np.random.default_rng(0))
    with pytest.raises(ValueError, match="at least 8 pixels; got 4"):
        texture("paint", np.random.default_rng(0), 4)
