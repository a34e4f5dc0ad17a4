"""The density of a photo's own colours, in place of the uniform one."""

import math

import numpy as np
import pytest

from tests.support import assert_close
from vig.likelihood import log_colour_density

CELLS = 24  # of the histogram along each channel


def density_on_cube(colours: np.ndarray, per_cell: int = 2) -> np.ndarray:
    """Density, relative to uniform, at midpoints of a grid over the colour cube, given surroundings (n, 3).

    The grid's colours enter the photo with weight 0: they are looked up, not counted.
    """
    count = per_cell * (CELLS - 1)
    grid = (np.indices((count, count, count)).reshape(3, -1).T + 0.5) / count
    photo = np.concatenate([colours, grid])[None].astype(np.float32)
    weight = np.repeat(np.float32([1, 0]), [len(colours), len(grid)])[None]
    return np.exp(log_colour_density(photo, weight)[0, len(colours) :])


@pytest.mark.parametrize("colour", [None, (0.0, 0.0, 0.0), (1.0, 0.4, 0.0), (0.5, 0.3, 0.7)])
def test_it_is_a_density(colour: tuple[float, float, float] | None) -> None:
    """Its mean over the cube is 1, even where all colours sit on a face or in a corner of the cube.

    Within a cell the density is linear along each axis, so midpoints of half cells sum it exactly.
    """
    rng = np.random.default_rng(0)
    shown = rng.uniform(0, 1, (500, 3)) if colour is None else np.array([colour])
    assert density_on_cube(shown).mean() == pytest.approx(1.0, abs=1e-6)


def test_colours_of_the_surroundings_are_likely_and_others_have_the_floor() -> None:
    photo = np.full((10, 20, 3), 0.3, np.float32)
    photo[:, 10:] = [0.8, 0.1, 0.1]
    weight = np.zeros((10, 20), np.float32)
    weight[:, :10] = 1
    density = log_colour_density(photo, weight)
    assert density.shape == (10, 20) and density.dtype == np.float64
    assert (density[:, :10] > math.log(500)).all()  # 22 cells a side, spread over about three
    assert_close(density[:, 10:], np.full((10, 10), math.log(0.05)))


def test_a_region_of_weight_zero_is_ignored_whatever_it_shows() -> None:
    rng = np.random.default_rng(1)
    photo = rng.uniform(0, 1, (20, 20, 3)).astype(np.float32)
    weight = np.ones((20, 20), np.float32)
    weight[5:15, 5:15] = 0
    other = photo.copy()
    other[5:15, 5:15] = rng.uniform(0, 1, (10, 10, 3)).astype(np.float32)
    outside = weight > 0
    first, second = log_colour_density(photo, weight), log_colour_density(other, weight)
    assert np.array_equal(first[outside], second[outside])


def test_only_the_proportions_of_the_weights_count() -> None:
    photo = np.random.default_rng(2).uniform(0, 1, (12, 12, 3)).astype(np.float32)
    weight = np.random.default_rng(3).uniform(0, 1, (12, 12)).astype(np.float32)
    assert_close(log_colour_density(photo, weight), log_colour_density(photo, 0.1 * weight))


def test_colours_outside_the_cube_count_as_on_its_border() -> None:
    inside, outside = np.ones((4, 4, 3), np.float32), np.full((4, 4, 3), 1.2, np.float32)
    weight = np.ones((4, 4), np.float32)
    assert_close(log_colour_density(outside, weight), log_colour_density(inside, weight))
