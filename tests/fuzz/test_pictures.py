"""Damaged photos, panoramas and boxes: a picture, or one line."""

from __future__ import annotations

import io
import struct
import zlib
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest
from PIL import Image

from tests.fuzz.mutations import damaged, outcomes
from tests.vig.photo.pictures import chrm, cicp, gama, png, profile, tiff
from vig.io.errors import UserError
from vig.photo.images import read_photo
from vig.photo.window import Window
from vig_app.cli.boxes import parse_box
from vig_world.assets.hdr import read_panorama

FORMATS = {
    "PNG": {},
    "JPEG": {},
    "WEBP": {},
    "TIFF": {"compression": "tiff_lzw"},
    "BMP": {},
    "GIF": {},
    "PPM": {},
    "JPEG2000": {},
    "AVIF": {},
    "MPO": {"save_all": True, "append_images": [Image.new("RGB", (60, 40))]},
}


def mutants(data: bytes, path: Path, count: int, seed: int) -> Iterator[Path]:
    rng = np.random.default_rng(seed)
    for _ in range(count):
        path.write_bytes(damaged(data, rng))
        yield path


@pytest.mark.parametrize("name", FORMATS)
def test_damaged_photos(name: str, tmp_path: Path) -> None:
    image = Image.fromarray(np.random.default_rng(0).integers(0, 256, (24, 20, 3), np.uint8))
    held = io.BytesIO()
    image.save(held, format=name, **FORMATS[name])

    def read(path: Path) -> None:
        photo = read_photo(path)
        assert photo.ndim == 3 and photo.dtype == np.float32
        assert 0 <= photo.min() and photo.max() <= 1  # NaN fails both

    counts = outcomes(mutants(held.getvalue(), tmp_path / "photo", 200, 1), read)
    assert counts.total() == 200 and counts["refused"] > 20


def rich_files(folder: Path) -> Iterator[Path]:
    """Photos whose containers state much: colours, depth, pages, transparency."""
    noise = np.random.default_rng(2).integers(1, 65536, (20, 24, 4)).astype(np.uint16)
    stated = (cicp(9, 16), gama(1), chrm(0.3127, 0.329, 0.64, 0.33, 0.21, 0.71, 0.15, 0.06))
    yield png(folder / "hdr.png", noise, 6, *stated)
    icc = (b"iCCP", b"x\0\0" + zlib.compress(profile(b"GRAY", 1)))
    yield png(folder / "grey.png", noise[..., :2], 4, icc, *stated[1:])
    yield png(folder / "key.png", noise[..., :3], 2, (b"tRNS", bytes(6)), (b"pHYs", bytes(9)))
    small = np.full((20, 24, 3), 9, np.uint8)
    yield tiff(folder / "pages.tif", (small, {254: 1}), (noise[..., :3], {281: (4095,) * 3, 274: 6}))
    yield tiff(folder / "white.tif", (noise[..., :1], {262: 0, 341: 16383}), (small, {}))
    yield tiff(folder / "packed.tif", (noise.tobytes(), {258: (10,) * 3, 262: 2, 277: 3, 274: 8}))
    if find_spec("pillow_heif"):
        import pillow_heif

        pillow_heif.from_pillow(Image.fromarray(small)).save(folder / "a.heic", transfer_characteristics=18)
        yield folder / "a.heic"


def test_damaged_photos_that_state_much(tmp_path: Path) -> None:
    def read(path: Path) -> None:
        photo = read_photo(path)
        assert photo.ndim == 3 and photo.dtype == np.float32
        assert 0 <= photo.min() and photo.max() <= 1

    for path in rich_files(tmp_path):
        read(path)
        counts = outcomes(mutants(path.read_bytes(), path, 150, 5), read)
        assert counts.total() == 150 and counts["refused"] > 5


def test_damaged_panoramas_of_openexr(tmp_path: Path) -> None:
    spec = oiio.ImageSpec(32, 16, 3, oiio.HALF)
    spec.full_width, spec.full_height = 64, 32
    spec.attribute("chromaticities", oiio.TypeDesc("float[8]"), (0.7, 0.3, 0, 1, 0.1, 0, 0.32, 0.34))
    target = oiio.ImageOutput.create(str(tmp_path / "p.exr"))
    target.open(str(tmp_path / "p.exr"), spec)
    target.write_image(np.random.default_rng(3).uniform(0.1, 9, (16, 32, 3)).astype(np.float32))
    target.close()

    def read(path: Path) -> None:
        image = read_panorama(path)
        assert np.isfinite(image).all() and image.min() >= 0

    counts = outcomes(mutants((tmp_path / "p.exr").read_bytes(), tmp_path / "p.exr", 200, 4), read)
    assert counts.total() == 200 and counts["refused"] > 20


def test_damaged_panoramas(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    pixels = rng.integers(1, 200, (16, 32, 4), np.uint8)
    pixels[..., 3] = 128
    data = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 16 +X 32\n" + pixels.tobytes()
    (tmp_path / "p.hdr").write_bytes(data)
    assert read_panorama(tmp_path / "p.hdr").shape == (16, 32, 3)

    def read(path: Path) -> None:
        image = read_panorama(path)
        assert np.isfinite(image).all() and image.min() >= 0

    counts = outcomes(mutants(data, tmp_path / "p.hdr", 200, 2), read)
    assert counts.total() == 200 and counts["refused"] > 20


def test_photos_of_monstrous_size(tmp_path: Path) -> None:
    """By their header; nothing is decoded."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    for side in (16_001, 20_000, 2**31 - 1):
        header = struct.pack(">IIBBBBB", side, side, 8, 2, 0, 0, 0)
        data = b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", b"") + chunk(b"IEND", b"")
        (tmp_path / "huge.png").write_bytes(data)
        with pytest.raises(UserError, match="expected at most 250 megapixels|a damaged one"):
            read_photo(tmp_path / "huge.png")


def test_boxes() -> None:
    """Strange numbers and texts for --box, on photos of strange shapes."""
    rng = np.random.default_rng(3)
    words = [
        "0",
        "-1",
        "1e308",
        "nan",
        "inf",
        "-inf",
        "8",
        "16.5",
        "1e-300",
        "",
        " ",
        "x",
        "0x10",
        "9" * 400,
        "½",
        "1_0",
    ]
    texts = [",".join(rng.choice(words, int(rng.integers(1, 6)))) for _ in range(500)]
    texts += [",".join(f"{value:g}" for value in rng.uniform(0, 60, 4)) for _ in range(100)]

    def read(text: str) -> None:
        width, height = (int(side) for side in rng.integers(16, 120, 2))
        window = Window.of(width, height, parse_box(text))
        cut, known = window.crop(np.zeros((height, width, 3), np.float32))
        assert cut.shape == (150, 150, 3) and known.any()

    counts = outcomes(texts, read)
    assert counts.total() == 600 and counts["refused"] > 400 and counts["accepted"] > 10


@pytest.mark.parametrize(
    "box", [(float("nan"), 0, 20, 20), (0, 0, float("inf"), 20), (0, 0, float("nan"), 20)]
)
def test_boxes_that_are_not_finite(box: tuple[float, float, float, float]) -> None:
    with pytest.raises(UserError, match="expected a box"):
        Window.of(64, 64, box)
