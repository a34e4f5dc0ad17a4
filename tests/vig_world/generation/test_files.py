"""Files that the maker of a dataset writes."""

from __future__ import annotations

import io

import numpy as np
import pytest
from PIL import Image

from vig_world.generation.files import png


@pytest.mark.parametrize(
    ("shape", "dtype", "mode"),
    [
        ((7, 5, 3), np.uint8, "RGB"),
        ((7, 5), np.uint8, "L"),
        ((7, 5), np.uint16, "I;16"),
        ((1, 1), np.uint8, "L"),
    ],
)
def test_pillow_reads_what_was_written(shape: tuple[int, ...], dtype: type, mode: str) -> None:
    image = np.random.default_rng(0).integers(np.iinfo(dtype).max + 1, size=shape).astype(dtype)
    read = Image.open(io.BytesIO(png(image)))
    assert (read.format, read.mode) == ("PNG", mode)
    np.testing.assert_array_equal(np.asarray(read), image)


def test_smooth_pictures_become_small() -> None:
    slope = np.add.outer(np.arange(150), np.arange(150)).astype(np.uint16) * 100
    assert len(png(slope)) < slope.nbytes / 10
