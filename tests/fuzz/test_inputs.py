"""Damaged photos, panoramas, masks, cameras and boxes: what they hold, or one line."""

import json
import zlib
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import OpenImageIO as oiio
import pytest
from PIL import Image

from tests.fuzz.mutations import damaged, damaged_json, outcomes, read_damaged
from tests.vig.photo.pictures import chrm, cicp, gama, png, profile, tiff
from vig.photo import Intrinsics
from vig.photo.images import read_photo
from vig.photo.masks import read_mask
from vig.photo.window import Window
from vig_app.cli.boxes import boxes_of, parse_box
from vig_app.cli.hints import cameras_of
from vig_app.cli.options import CameraOptions, HintOptions, PlaceOptions
from vig_world.assets.hdr import read_panorama

COUNT = 100
FORMATS: dict[str, dict[str, Any]] = {
    **{name: {} for name in ("PNG", "JPEG", "WEBP", "BMP", "GIF", "PPM", "JPEG2000", "AVIF")},
    "TIFF": {"compression": "tiff_lzw"},
    "MPO": {"save_all": True, "append_images": [Image.new("RGB", (60, 40))]},
}


def photo(path: Path) -> None:
    found = read_photo(path)
    assert found.ndim == 3 and found.dtype == np.float32
    assert 0 <= found.min() and found.max() <= 1  # NaN fails both


def panorama(path: Path) -> None:
    image = read_panorama(path)
    assert np.isfinite(image).all() and image.min() >= 0


@pytest.mark.parametrize("name", FORMATS)
def test_damaged_photos(name: str, tmp_path: Path) -> None:
    image = Image.fromarray(np.random.default_rng(0).integers(0, 256, (24, 20, 3), np.uint8))
    image.save(tmp_path / "photo", format=name, **FORMATS[name])
    read_damaged(tmp_path / "photo", damaged, photo, COUNT, 1, COUNT // 10)


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
    if find_spec("pillow_heif"):
        import pillow_heif

        pillow_heif.from_pillow(Image.fromarray(small)).save(folder / "a.heic", transfer_characteristics=18)
        yield folder / "a.heic"


def test_damaged_photos_that_state_much(tmp_path: Path) -> None:
    for path in rich_files(tmp_path):
        read_damaged(path, damaged, photo, 60, 5, 2)


def test_damaged_panoramas_of_openexr(tmp_path: Path) -> None:
    spec = oiio.ImageSpec(32, 16, 3, oiio.HALF)
    spec.full_width, spec.full_height = 64, 32
    spec.attribute("chromaticities", oiio.TypeDesc("float[8]"), (0.7, 0.3, 0, 1, 0.1, 0, 0.32, 0.34))
    target = oiio.ImageOutput.create(str(tmp_path / "p.exr"))
    target.open(str(tmp_path / "p.exr"), spec)
    target.write_image(np.random.default_rng(3).uniform(0.1, 9, (16, 32, 3)).astype(np.float32))
    target.close()
    read_damaged(tmp_path / "p.exr", damaged, panorama, COUNT, 4, COUNT // 10)


def test_damaged_panoramas(tmp_path: Path) -> None:
    pixels = np.random.default_rng(1).integers(1, 200, (16, 32, 4), np.uint8)
    pixels[..., 3] = 128
    (tmp_path / "p.hdr").write_bytes(
        b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 16 +X 32\n" + pixels.tobytes()
    )
    read_damaged(tmp_path / "p.hdr", damaged, panorama, COUNT, 2, COUNT // 10)


def test_boxes() -> None:
    """Strange numbers and texts for --box, on photos of strange shapes."""
    rng = np.random.default_rng(3)
    words = ["0", "-1", "1e308", "nan", "inf", "-inf", "8", "16.5", "1e-300", "", " ", "x", "0x10", "9" * 400]
    words += ["½", "1_0"]
    texts = [",".join(rng.choice(words, int(rng.integers(1, 6)))) for _ in range(500)]
    texts += [",".join(f"{value:g}" for value in rng.uniform(0, 60, 4)) for _ in range(100)]

    def read(text: str) -> None:
        width, height = (int(side) for side in rng.integers(16, 120, 2))
        window = Window.of(width, height, parse_box(text))
        cut, known = window.crop(np.zeros((height, width, 3), np.float32))
        assert cut.shape == (150, 150, 3) and known.any()

    counts = outcomes(texts, read)
    assert counts.total() == 600 and counts["refused"] > 400 and counts["accepted"] > 10


def test_damaged_masks(tmp_path: Path) -> None:
    path, mask = tmp_path / "mask.png", np.zeros((40, 60), np.uint8)
    mask[10:30, 20:40] = 255
    Image.fromarray(np.dstack([mask] * 4)).save(path)

    def read(path: Path) -> None:
        found = read_mask(path)
        assert found.dtype == bool and found.ndim == 2

    read_damaged(path, damaged, read, COUNT, 3, COUNT // 10)


BOXES = [{"7.png": [10, 20, 30, 40], "8.png": [{"box": [1, 2, 30, 40], "class": "mug"}]}]
K = [900, 0, 310, 0, 880, 250, 0, 0, 1]
CAMERAS = [
    {"7": {"cam_K": K}, "8": [900, 880, 310, 250]},
    {"a/7.png": {"K": K, "D": [0, 0], "width": 640, "height": 480}, "7.png": [900, 880, 310, 250]},
    {"camera_matrix": {"rows": 3, "data": K}, "distortion": {"k1": 0, "data": [0]}, "resolution": [640, 480]},
    {"camera_model": "OPENCV", "params": [900, 880, 310, 250, 0], "image_width": 640, "image_height": 480},
]


@pytest.mark.parametrize("kind", ["boxes", "cameras"])
def test_damaged_cameras_and_boxes(kind: str, tmp_path: Path) -> None:
    photo, path, rng = tmp_path / "7.png", tmp_path / "given.json", np.random.default_rng(4)
    whole = [json.dumps(content).encode() for content in (CAMERAS if kind == "cameras" else BOXES)]

    def read(number: int) -> None:
        path.write_bytes(damaged_json(whole[number % len(whole)], rng))
        if kind == "cameras":
            (camera,) = cameras_of(CameraOptions(cameras=path), [photo])
            assert np.isfinite(Intrinsics.of(camera, 640, 480).K).all()
        else:
            ((box, _),) = boxes_of(PlaceOptions(boxes=path), [photo], HintOptions())
            assert box is None or np.isfinite(box).all()

    counts = outcomes(range(COUNT), read)
    assert counts.total() == COUNT and counts["refused"] > COUNT // 5
