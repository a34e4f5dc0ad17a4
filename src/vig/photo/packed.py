"""TIFF samples of 9 to 16 bits that pillow does not unpack."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any, Literal

import numpy as np
from PIL import Image, TiffImagePlugin
from PIL.ExifTags import Base as Tag

from vig.photo import formats
from vig.photo.checks import check_size

BLOCK = 64
"""Rows that are unpacked at a time: a bit takes a byte meanwhile."""


def packed_picture(path: Path) -> Image.Image | None:
    """Return the largest page of a TIFF file of 9 to 16 bits a sample, scaled: mode I;16, RGB or RGBA.

    Pillow decompresses it as 8-bit grey, the bytes of each row, of whose bits samples are put together here.
    None where the file is another kind: tiles, planes, predictors, premultiplied alpha, signed samples.
    """
    page = formats.largest_page(path)
    data = path.read_bytes()
    if page is None or page.number is None or 43 in data[2:4]:
        return None
    tags = page.tags
    bits, channels = tags.get(Tag.BitsPerSample, (1,)), tags.get(Tag.SamplesPerPixel, 1)
    extra, photometric = tags.get(Tag.ExtraSamples, ()), tags.get(Tag.PhotometricInterpretation)
    usual = {Tag.PlanarConfiguration: 1, Tag.Predictor: 1, Tag.FillOrder: 1}
    if (
        set(bits) != {bits[0]}
        or not 8 < bits[0] <= 16
        or (photometric, channels - len(extra)) not in ((0, 1), (1, 1), (2, 3))
        or (extra and (channels == 2 or extra[0] == 1))
        or set(tags.get(Tag.SampleFormat, (1,))) != {1}
        or any(tags.get(tag, value) != value for tag, value in usual.items())
        or not {Tag.StripOffsets, Tag.StripByteCounts} <= tags.keys()
    ):
        return None
    check_size(path, *page.size)
    samples = _unpacked(_rows(data, tags, page.size, channels * bits[0]), page.size[0] * channels, bits[0])
    samples = samples.reshape(page.size[1], page.size[0], channels)
    white = formats.white_level(tags)
    samples = np.minimum(samples, white)
    if photometric == 0:
        samples = white - samples
    if channels - len(extra) == 1:
        picture = Image.fromarray((samples[..., 0].astype(np.uint32) * 65535 // white).astype(np.uint16))
    else:
        alpha = extra[:1] == (2,)
        picture = Image.fromarray(np.rint(samples[..., : 3 + alpha] * (255 / white)).astype(np.uint8))
    picture.info["icc_profile"] = tags.get(Tag.InterColorProfile)
    picture.getexif()[Tag.Orientation] = tags.get(Tag.Orientation, 1)
    return picture


def _rows(data: bytes, tags: Any, size: tuple[int, int], bits: int) -> np.ndarray:
    """Return the decompressed bytes of a page's rows, (H, bytes of a row) uint8."""
    directory = TiffImagePlugin.ImageFileDirectory_v2(data[:8])
    for tag, value in (
        (Tag.ImageWidth, -(-size[0] * bits // 8)),
        (Tag.ImageLength, size[1]),
        (Tag.BitsPerSample, 8),
        (Tag.Compression, tags.get(Tag.Compression, 1)),
        (Tag.PhotometricInterpretation, 1),
        (Tag.StripOffsets, tags[Tag.StripOffsets]),
        (Tag.SamplesPerPixel, 1),
        (Tag.RowsPerStrip, tags.get(Tag.RowsPerStrip, size[1])),
        (Tag.StripByteCounts, tags[Tag.StripByteCounts]),
    ):
        directory[tag] = value
    order: Literal["little", "big"] = "little" if data[:2] == b"II" else "big"
    # Pillow takes strips as counted from the directory's end, which is where the file goes, then.
    whole = data[:4] + (8).to_bytes(4, order) + directory.tobytes(8) + data
    with Image.open(io.BytesIO(whole), formats=("TIFF",)) as image:
        return np.asarray(image)


def _unpacked(rows: np.ndarray, count: int, bits: int) -> np.ndarray:
    """Return samples (H, count) uint16, the first bit of each the highest, of rows (H, bytes) uint8."""
    samples = np.empty((len(rows), count), np.uint16)
    weights = (1 << np.arange(bits)[::-1]).astype(np.uint16)
    for start in range(0, len(rows), BLOCK):
        block = np.unpackbits(rows[start : start + BLOCK], axis=1)[:, : count * bits]
        samples[start : start + BLOCK] = block.reshape(len(block), count, bits) @ weights
    return samples
