"""Filters beside those of scipy."""

import numpy as np
import pytest
from scipy import ndimage

from vig.photo.filters import dilation, erosion, gaussian_filter

RNG = np.random.default_rng(0)


@pytest.mark.parametrize(
    ("deviation", "mode", "theirs"), [(0.5, "edge", "nearest"), (16, "symmetric", "reflect")]
)
@pytest.mark.parametrize("shape", [(40, 30), (9, 70, 3)])
def test_a_gaussian(shape: tuple[int, ...], deviation: float, mode: str, theirs: str) -> None:
    image = RNG.random(shape, np.float32)
    sigma = (deviation, deviation, 0)[: len(shape)]
    smooth = gaussian_filter(image, deviation, mode)
    assert smooth.dtype == np.float32
    np.testing.assert_allclose(smooth, ndimage.gaussian_filter(image, sigma, mode=theirs), atol=1e-6)


@pytest.mark.parametrize("steps", [1, 4])
def test_masks_grow_and_shrink(steps: int) -> None:
    mask = RNG.random((30, 20)) > 0.9
    np.testing.assert_array_equal(dilation(mask, steps), ndimage.binary_dilation(mask, iterations=steps))
    np.testing.assert_array_equal(erosion(~mask, steps), ndimage.binary_erosion(~mask, iterations=steps))
