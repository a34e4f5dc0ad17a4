"""Textures: range, shape, determinism, tiling."""

import numpy as np
import pytest

from vig_world.assets.textures import (
    FINISHES,
    KINDS,
    colour,
    decoration,
    near,
    noise,
    partner,
    shade,
    texture,
)
from vig_world.assets.textures.lettering import BLANK, alphabet, paragraph, title, word


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


@pytest.mark.parametrize("kind", [name for name, kind in KINDS.items() if kind.periodic])
def test_surfaces_tile(kind):
    """The step across the border is not larger than the largest step between rows or columns inside."""
    for seed in range(4):
        image = texture(kind, np.random.default_rng(seed), 64)
        for axis in (0, 1):
            steps = np.abs(np.diff(image, axis=axis)).mean(axis=(1 - axis, 2))
            across = np.abs(image.take(0, axis) - image.take(-1, axis)).mean()
            assert across <= 1.5 * steps.max()


def test_finishes_name_kinds_that_tile_and_have_a_scale():
    assert set(FINISHES) == {"wall", "floor", "ceiling", "wood", "top", "fabric"}
    assert all(KINDS[kind].periodic for slot in FINISHES.values() for kind in slot)
    assert all(0 < kind.metres[0] < kind.metres[1] for kind in KINDS.values())
    assert [name for name, kind in KINDS.items() if not kind.periodic] == ["news", "page", "picture", "print"]


def test_decoration_goes_round_without_a_seam():
    """Beside the seam it differs no more than beside any other column; it covers some, not all."""
    shares = []
    for seed in range(20):
        layer = decoration(np.random.default_rng(seed), 64)
        assert layer.shape == (64, 128, 4) and layer.dtype == np.float32
        assert layer[..., 3].min() >= 0 and layer[..., 3].max() <= 1
        assert layer[..., :3].min() >= 0.02 and layer[..., :3].max() <= 0.95
        cover = layer[..., 3]
        assert (
            np.abs(cover[:, 0] - cover[:, -1]).mean() <= np.abs(np.diff(cover, axis=1)).mean(0).max() + 1e-6
        )
        shares.append((cover > 0.5).mean())
    assert 0.02 < min(shares) and max(shares) < 0.7
    with pytest.raises(ValueError, match="at least 32 pixels; got 16"):
        decoration(np.random.default_rng(0), 16)


def test_letters_differ_and_words_alternate():
    letters = alphabet(12, False, 0.15)
    assert letters.shape[:2] == (27, 12) and letters[BLANK].max() == 0
    flat = letters[:26].reshape(26, -1)
    distance = np.abs(flat[:, None] - flat[None]).sum(-1) + 99 * np.eye(26)
    assert distance.min() > 2  # pixels of ink
    rng = np.random.default_rng(0)
    vowels = np.isin(word(rng, 8), [0, 4, 8, 14, 20])
    assert (vowels[1:] != vowels[:-1]).all()


def test_text_keeps_to_its_box_in_lines():
    rng = np.random.default_rng(0)
    for _ in range(20):
        mask = title(rng, 100, 20)
        assert mask.shape[0] <= 20 and mask.shape[1] <= 100 and mask.max() > 0.8
    text = paragraph(rng, 90, 40, 4)
    assert text.shape == (40, 90)
    rows = text.sum(1)
    assert (rows[4:6] == 0).all() and rows[:4].min() > 0  # four rows of letters, two of leading


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


def test_colours_are_mostly_quiet_yet_a_good_share_are_like_an_explained_object():
    rng = np.random.default_rng(1)
    colours = np.array([colour(rng) for _ in range(2000)])
    vivid = np.ptp(colours, axis=1) > 0.5
    assert vivid.mean() < 0.2
    likeable = ((colours > 0.2) & (colours < 0.8)).all(1)
    assert likeable.mean() > 0.3
    tinted = likeable & (np.ptp(colours, axis=1) > 0.2)
    assert tinted.mean() > 0.15


def test_partners_can_be_told_apart():
    rng = np.random.default_rng(2)
    for _ in range(300):
        base = colour(rng)
        other = partner(base, rng)
        assert other.min() >= 0.02 and other.max() <= 0.95
        assert np.abs(np.cbrt(other) - np.cbrt(base)).max() > 0.03


def test_shade_keeps_the_tint():
    rng = np.random.default_rng(0)
    base = np.array([0.3, 0.4, 0.5])
    for _ in range(100):
        ratio = shade(base, rng, 0.3) / base
        assert np.ptp(ratio) < 0.07 and 0.68 < ratio.min() and ratio.max() < 1.34


def test_near_stays_near():
    rng = np.random.default_rng(0)
    base = np.float32([0.3, 0.4, 0.5])
    shifted = np.array([near(base, rng, 0.1) for _ in range(100)])
    assert np.abs(shifted / base - 1).max() <= 0.15 + 1e-6


def test_refuses_unknown_kinds_and_tiny_sizes():
    with pytest.raises(ValueError, match="kind must be one of brick, checker"):
        texture("velvet", np.random.default_rng(0))
    with pytest.raises(ValueError, match="at least 8 pixels; got 4"):
        texture("paint", np.random.default_rng(0), 4)
