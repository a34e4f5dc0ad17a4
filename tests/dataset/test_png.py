from __future__ import annotations

import io

import numpy as np
import pytest
from PIL import Image

from vig.dataset.png import png


@pytest.mark.parametrize("noisy", [False, True])
@pytest.mark.parametrize(("shape", "dtype"), [((7, 5), "uint8"), ((4, 9), "uint16"), ((6, 3, 3), "uint8")])
def test_others_read_the_same_values(shape: tuple[int, ...], dtype: str, noisy: bool) -> None:
    image = np.random.default_rng(3).integers(0, np.iinfo(dtype).max, shape, dtype, endpoint=True)
    read = np.array(Image.open(io.BytesIO(png(image, noisy))))
    np.testing.assert_array_equal(read, image)


def test_an_image_that_is_no_whole_block_of_memory_is_written_all_the_same() -> None:
    image = np.arange(200, dtype=np.uint8).reshape(10, 20)[::2, ::3]
    np.testing.assert_array_equal(np.array(Image.open(io.BytesIO(png(image)))), image)
