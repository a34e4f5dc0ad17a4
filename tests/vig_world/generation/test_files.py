"""Files that the maker of a dataset writes."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from vig_world.generation.files import png, write_picture


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


def test_a_picture_takes_the_place_of_what_is_there(tmp_path: Path) -> None:
    """Half a file that a killed run left, and a link, which is not followed."""
    whole, half, link, other = (tmp_path / name for name in ("new/a.png", "b.png", "c.png", "other"))
    half.write_bytes(b"hal")
    other.write_bytes(b"mine")
    link.symlink_to(other)
    for path in (whole, half, link):
        write_picture(path, b"picture")
        assert path.read_bytes() == b"picture" and not path.is_symlink()
    assert other.read_bytes() == b"mine"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["b.png", "c.png", "new", "other"]
