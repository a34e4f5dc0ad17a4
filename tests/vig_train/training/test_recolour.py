"""Only the object's visible pixels change, and to what the new albedo says."""

import numpy as np

from vig.scene import linear_from_srgb, srgb8_from_linear
from vig_train.training.recolour import recolour


def test_only_what_is_seen_of_the_object_changes() -> None:
    rng = np.random.default_rng(0)
    image = rng.integers(0, 255, (40, 40, 3)).astype(np.uint8)
    visible = np.zeros((40, 40), bool)
    visible[10:30, 5:25] = True
    made, _ = recolour(image, visible, np.array([0.5, 0.5, 0.5], np.float32), rng)
    assert np.array_equal(made[~visible], image[~visible])
    assert not np.array_equal(made[visible], image[visible])


def test_light_on_the_object_stays_and_its_mean_albedo_is_stated() -> None:
    """A surface of albedo .5 in falling light: the new picture over the new albedo is that light."""
    light = np.linspace(1.0, 0.05, 60, dtype=np.float32)[None, :, None].repeat(60, 0)
    old = np.array([0.5, 0.5, 0.5], np.float32)
    image = srgb8_from_linear(light * old)
    errors = []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        made, new = recolour(image, np.ones((60, 60), bool), old, rng)
        seen = linear_from_srgb(made.astype(np.float32) / 255)
        errors.append(np.abs(seen.mean((0, 1)) / (light.mean() * new) - 1).max())
    assert np.median(errors) < 0.15, "glints and paint on the lit side change the mean of some"


def test_an_unseen_object_is_left_alone() -> None:
    image = np.full((8, 8, 3), 7, np.uint8)
    made, albedo = recolour(image, np.zeros((8, 8), bool), np.full(3, 0.3), np.random.default_rng(0))
    assert np.array_equal(made, image) and np.allclose(albedo, 0.3)
