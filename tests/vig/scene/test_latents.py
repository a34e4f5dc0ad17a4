import numpy as np
import pytest

from vig.scene import Latents, latent_layout


@pytest.mark.parametrize("modes", [0, 1, 10])
def test_vectors_and_latents_are_the_same_numbers(modes: int) -> None:
    vector = np.random.default_rng(0).normal(size=(4, modes + 14))
    latents = Latents.from_vector(vector)
    assert np.array_equal(latents.to_vector(), vector)
    assert latents.shape.shape == (4, modes)
    assert latents.azimuth.shape == latents.elevation.shape == (4,)
    assert latents.albedo.shape == (4, 3) and latents.light.shape == (4, 9)
    assert len(latents) == 4


def test_the_order_is_shape_pose_albedo_light() -> None:
    latents = Latents.from_vector(np.arange(24.0)[None])
    assert latents.shape[0].tolist() == list(range(10))
    assert (latents.azimuth, latents.elevation) == (10, 11)
    assert latents.albedo[0].tolist() == [12, 13, 14]
    assert latents.light[0].tolist() == list(range(15, 24))
    names = latent_layout(10).labels
    assert len(names) == len(set(names)) == 24
    assert names[10:16] == ("azimuth", "elevation", "albedo_r", "albedo_g", "albedo_b", "light_0_0")


def test_indexing_keeps_whole_explanations() -> None:
    vector = np.random.default_rng(1).normal(size=(5, 24))
    latents = Latents.from_vector(vector)
    assert np.array_equal(latents[1:3].to_vector(), vector[1:3])
    assert np.array_equal(latents[np.array([4, 0])].to_vector(), vector[[4, 0]])
