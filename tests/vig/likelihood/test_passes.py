"""Passes, which serve the photos of one likelihood after those of another."""

from __future__ import annotations

import gc
import weakref
from dataclasses import replace

import numpy as np
import torch

from tests.support import points_of
from vig.likelihood import Likelihood, Photos
from vig.likelihood.evaluate import FREE_POINTS
from vig.likelihood.kernels.geometry import Geometry


def photos_of(studio, seed: int, count: int = 1) -> Photos:
    rng = np.random.default_rng(seed)
    images = torch.cat([studio.photo(rng, studio.latents(rng)) for _ in range(count)])
    weights = rng.dirichlet((5, 2, 3), images.shape[:3])
    return Photos(images, torch.from_numpy(np.log(weights)))


def value_of(likelihood: Likelihood, points: torch.Tensor, photo: int = 0) -> torch.Tensor:
    count = len(points)
    index = torch.full((count,), photo, dtype=torch.int32)
    found = likelihood.at(points, index, torch.full((count,), 0.03, dtype=torch.float64))
    assert found.gradient is not None and found.normal is not None
    return torch.cat([found.value[:, None], found.gradient, found.normal.flatten(1)], 1)


def random_points(studio, seed: int, count: int) -> torch.Tensor:
    rng = np.random.default_rng(seed)
    return torch.cat([points_of(studio.latents(rng)) for _ in range(count)]).double()


def test_a_pass_that_served_other_photos_values_these_as_a_new_one_does(studio) -> None:
    points = random_points(studio, 0, 2)
    shared, given = studio.geometry, studio.camera
    camera = replace(given, focal=1.3 * given.focal, distance=1.2 * given.distance, target_height=0.01)
    first = Likelihood(shared, studio.camera, photos_of(studio, 1))
    second = Likelihood(shared, camera, photos_of(studio, 2, count=3))
    before = value_of(first, points)
    for photo in (2, 0):
        own = Geometry(shared.model, torch.float64)
        alone = Likelihood(own, camera, photos_of(studio, 2, count=3))
        torch.testing.assert_close(value_of(second, points, photo), value_of(alone, points, photo))
        assert not torch.equal(value_of(second, points, photo), before)
        torch.testing.assert_close(value_of(first, points), before)


def test_likelihoods_of_one_geometry_share_passes_and_keep_few(studio) -> None:
    geometry = Geometry(studio.geometry.model, torch.float64)
    points = random_points(studio, 0, 1)
    for seed in range(3):
        camera = replace(studio.camera, focal=studio.camera.focal + seed)
        value_of(Likelihood(geometry, camera, photos_of(studio, seed)), points)
    assert len(geometry.kept["passes"]) == 1
    given = photos_of(studio, 0)
    for number in range(FREE_POINTS + 3):
        value_of(Likelihood(geometry, studio.camera, given, stride=number + 1), points)
    assert len(geometry.kept["passes"]) == FREE_POINTS


def test_photos_are_gone_when_their_likelihood_is(studio) -> None:
    geometry = Geometry(studio.geometry.model, torch.float64)
    likelihood = Likelihood(geometry, studio.camera, photos_of(studio, 0))
    value_of(likelihood, random_points(studio, 0, 1))
    photos, array = weakref.ref(likelihood.observed), weakref.ref(likelihood.photo_arrays["observed"])
    del likelihood
    gc.collect()
    assert photos() is None and array() is None and len(geometry.kept["passes"]) == 1
