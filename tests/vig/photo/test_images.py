"""Pictures read to linear light, refused, and written; panoramas."""

import io
import os
import struct
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest
from PIL import Image, ImageCms

from tests.vig.photo.pictures import SIZE, flat, is_light, png, refused
from vig.photo.checks import MAX_PIXELS
from vig.photo.decoding import MID_GREY
from vig.photo.images import png_bytes, read_photo, write_png
from vig.photo.lens import focal_of
from vig.photo.masks import read_mask
from vig_world.assets.hdr import read_panorama

LINEAR_128 = 0.21586  # ((128/255 + 0.055) / 1.055) ** 2.4
LINEAR_32768 = ((32768 / 65535 + 0.055) / 1.055) ** 2.4
GREY = Image.new("L", SIZE, 128)


@pytest.mark.parametrize(
    ("picture", "ending", "light", "tolerance"),
    [
        (Image.new("RGB", SIZE, (255, 128, 0)), "png", (1.0, LINEAR_128, 0.0), 1e-4),
        (GREY, "png", LINEAR_128, 1e-4),
        (GREY.convert("P"), "png", LINEAR_128, 1e-4),
        (Image.new("1", SIZE, 1), "png", 1.0, 1e-4),
        (Image.fromarray(np.full(SIZE[::-1], 32768, np.uint16)), "png", LINEAR_32768, 1e-6),
        # No ink in cyan, all of magenta and yellow, no black: pure red.
        (Image.new("CMYK", SIZE, (0, 255, 255, 0)), "jpg", (1.0, 0.0, 0.0), 0.02),
        *(
            (GREY.convert("RGB"), ending, LINEAR_128, 0.01)
            for ending in ("jpg", "webp", "tif", "bmp", "gif", "ppm", "jp2", "avif")
        ),
    ],
)
def test_pictures_of_every_kind_become_linear_light(
    picture: Image.Image, ending: str, light: float, tolerance: float, tmp_path: Path
) -> None:
    picture.save(tmp_path / f"a.{ending}", **({"quality": 100} if picture.mode == "CMYK" else {}))
    photo = read_photo(tmp_path / f"a.{ending}")
    assert photo.shape == (SIZE[1], SIZE[0], 3)
    is_light(photo, light, tolerance)


def test_sixteen_bit_rgb(tmp_path: Path) -> None:
    photo = read_photo(png(tmp_path / "a.png", flat(65535, 0x8080, 0, dtype=np.uint16), 2))
    is_light(photo, (1.0, LINEAR_128, 0.0), 1e-4)


@pytest.mark.parametrize(("alpha", "share"), [(255, 1.0), (0, 0.0), (51, 0.2)])
def test_alpha_is_laid_over_mid_grey_in_linear_light(tmp_path: Path, alpha: int, share: float) -> None:
    Image.new("RGBA", SIZE, (255, 0, 0, alpha)).save(tmp_path / "a.png")
    under = (1 - share) * MID_GREY
    is_light(read_photo(tmp_path / "a.png"), (share + under, under, under), 1e-4)
    palette = Image.new("P", SIZE, 3)
    palette.putpalette(range(12))
    palette.save(tmp_path / "b.png", transparency=3)
    is_light(read_photo(tmp_path / "b.png"), MID_GREY, 1e-4)


def test_exif_orientation_is_applied(tmp_path: Path) -> None:
    picture = Image.new("RGB", SIZE, (0, 0, 0))
    picture.paste((255, 255, 255), (0, 0, SIZE[0], 8))  # a white band at the top of what is stored
    exif = picture.getexif()
    exif[0x0112] = 6  # stored sideways: to be turned a quarter clockwise for viewing
    picture.save(tmp_path / "a.png", exif=exif)
    photo = read_photo(tmp_path / "a.png")
    assert photo.shape == (SIZE[0], SIZE[1], 3)
    assert (photo[:, -8:] == 1).all() and (photo[:, :-8] == 0).all()  # the band is now at the right


def test_a_colour_profile_is_honoured_and_an_unreadable_one_is_ignored(tmp_path: Path) -> None:
    """A colour space whose first primary is sRGB's green and whose second is its red."""
    GREY.convert("RGB").save(tmp_path / "a.png", exif=b"Exif\0\0nonsense", icc_profile=b"nonsense")
    is_light(read_photo(tmp_path / "a.png"), LINEAR_128, 1e-4)
    profile = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
    swapped = profile.replace(b"rXYZ", b"????").replace(b"gXYZ", b"rXYZ").replace(b"????", b"gXYZ")
    for data, light in ((profile, (1.0, 0.0, 0.0)), (swapped, (0.0, 1.0, 0.0))):
        Image.new("RGB", SIZE, (255, 0, 0)).save(tmp_path / "b.png", icc_profile=data)
        is_light(read_photo(tmp_path / "b.png"), light, 0.01)


@pytest.mark.parametrize("told", [50, 0, 65000, None])
def test_the_focal_length_is_read_from_exif_or_none_is(tmp_path: Path, told: int | None) -> None:
    """50 mm of a film whose diagonal is 43.27 mm, in pixels of a picture whose diagonal is 500."""
    picture = Image.new("RGB", (400, 300))
    exif = picture.getexif()
    if told is not None:
        exif.get_ifd(0x8769)[0xA405] = told
    picture.save(tmp_path / "a.jpg", exif=exif)
    expected = pytest.approx(50 / 43.2666 * 500, rel=1e-4) if told == 50 else None
    for given in (tmp_path / "a.jpg", str(tmp_path / "a.jpg"), Image.open(tmp_path / "a.jpg")):
        assert focal_of(given) == expected
    for other in (tmp_path / "nothing.jpg", np.zeros((20, 20, 3)), 7):
        assert focal_of(other) is None


def test_pipes_are_refused_without_waiting(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.png")
    refused(tmp_path / "pipe.png", "a device or pipe")
    refused(tmp_path / "pipe.png" / "a.png", "expected a.* image file")


def noise(side: int = 64) -> Image.Image:
    return Image.fromarray(np.random.default_rng(0).integers(0, 256, (side, side, 3), dtype=np.uint8))


@pytest.mark.parametrize("suffix", ["png", "jpg", "webp", "gif", "tif"])
@pytest.mark.parametrize("share", [0.3, 0.6, 0.9])
def test_truncated_files_are_refused(tmp_path: Path, suffix: str, share: float) -> None:
    path = tmp_path / f"a.{suffix}"
    noise().save(path)
    path.write_bytes(path.read_bytes()[: int(share * path.stat().st_size)])
    refused(path, "damaged|something else")


def test_damaged_bytes_are_refused(tmp_path: Path) -> None:
    noise().save(tmp_path / "a.png")
    data = bytearray((tmp_path / "a.png").read_bytes())
    data[2000:2100] = bytes(100)
    (tmp_path / "a.png").write_bytes(data)
    refused(tmp_path / "a.png", "expected a whole photo; got a damaged one .* Save or copy it again")


@pytest.mark.parametrize("side", [16_001, 60_000])
def test_huge_images_are_refused_by_their_header(tmp_path: Path, side: int) -> None:
    # The pixels are not even there: whoever decodes first fails with another message.
    data = bytearray(png(tmp_path / "bomb.png", flat(0, 0, 0), 2).read_bytes())
    data[16:24] = struct.pack(">II", side, side)
    data[29:33] = struct.pack(">I", zlib.crc32(data[12:29]))
    (tmp_path / "bomb.png").write_bytes(data)
    assert side**2 > MAX_PIXELS
    for read in (read_photo, read_mask):
        refused(tmp_path / "bomb.png", "expected at most 250 megapixels; got .* Make it smaller", read)
    assert focal_of(tmp_path / "bomb.png") is None


def test_photos_of_many_megapixels_are_read_up_to_what_memory_takes(monkeypatch, tmp_path: Path) -> None:
    """Pillow's own limit, twice `MAX_IMAGE_PIXELS`, would refuse those of phones; floats take more memory."""
    monkeypatch.setattr(Image, "MAX_IMAGE_PIXELS", 100)
    monkeypatch.setattr("vig.photo.decoding.MAX_FLOAT_PIXELS", 20 * 20 - 1)
    for mode, name in (("RGB", "a.jpg"), ("RGB", "a.png"), ("L", "a.tif")):
        Image.new(mode, (20, 20)).save(tmp_path / name)
        assert read_photo(tmp_path / name).shape == (20, 20, 3)
    Image.new("RGBA", (20, 20), (9, 9, 9, 99)).save(tmp_path / "b.png")
    refused(tmp_path / "b.png", "of 16 bits, HDR or with transparency; got 20 x 20")
    assert Image.MAX_IMAGE_PIXELS == 100


def test_written_floats_are_linear_light_and_bytes_and_masks_are_as_they_are(tmp_path: Path) -> None:
    rng = np.random.default_rng(2)
    linear = rng.uniform(0, 1, (20, 30, 3)).astype(np.float32)
    write_png(tmp_path / "sub" / "a.png", linear)
    # Half a step of 8-bit sRGB is at most 0.5/255 x the steepest slope of the decoding, 2.4/1.055.
    is_light(read_photo(tmp_path / "sub" / "a.png"), linear, 0.5 / 255 * 2.4 / 1.055)
    picture = rng.integers(0, 256, (20, 30, 4), dtype=np.uint8)
    write_png(tmp_path / "a.png", picture)
    np.testing.assert_array_equal(np.asarray(Image.open(tmp_path / "a.png")), picture)
    write_png(tmp_path / "b.png", picture[..., 0] > 99)
    np.testing.assert_array_equal(np.asarray(Image.open(tmp_path / "b.png")) == 255, picture[..., 0] > 99)


@pytest.mark.parametrize(
    ("shape", "dtype", "mode"),
    [
        ((7, 5, 3), np.uint8, "RGB"),
        ((7, 5), np.uint8, "L"),
        ((7, 5), np.uint16, "I;16"),
        ((1, 1), np.uint8, "L"),
        ((7, 5, 4), np.uint8, "RGBA"),
    ],
)
def test_pillow_reads_what_was_encoded(shape: tuple[int, ...], dtype: type, mode: str) -> None:
    image = np.random.default_rng(0).integers(np.iinfo(dtype).max + 1, size=shape).astype(dtype)
    read = Image.open(io.BytesIO(png_bytes(image)))
    assert (read.format, read.mode) == ("PNG", mode)
    np.testing.assert_array_equal(np.asarray(read), image)


def test_what_is_no_picture_is_not_encoded_and_smooth_ones_become_small() -> None:
    for picture in (np.zeros((4, 4), np.float32), np.zeros((0, 4), np.uint8)):
        with pytest.raises(ValueError, match="Convert it"):
            png_bytes(picture)
    slope = np.add.outer(np.arange(150), np.arange(150)).astype(np.uint16) * 100
    assert len(png_bytes(slope)) < slope.nbytes / 10


def hdr(path: Path, pixels: np.ndarray) -> Path:
    assert oiio.ImageBuf(np.ascontiguousarray(pixels, dtype=np.float32)).write(str(path))
    return path


def test_panoramas_come_back_as_written(tmp_path: Path) -> None:
    radiance = np.random.default_rng(4).uniform(0, 50, (16, 32, 4)).astype(np.float32)
    exr = read_panorama(hdr(tmp_path / "a.exr", radiance))  # of more channels the colours are taken
    assert exr.shape == (16, 32, 3) and exr.dtype == np.float32
    np.testing.assert_array_equal(exr, radiance[..., :3])
    # Radiance's shared exponent: 8 bits below the largest channel, truncated.
    read = read_panorama(hdr(tmp_path / "a.hdr", radiance[..., :3]))
    np.testing.assert_allclose(read, radiance[..., :3], atol=50 / 128)


def spoilt(value: float) -> np.ndarray:
    radiance = np.ones((16, 32, 3))
    radiance[3, 4, 1] = value
    return radiance


@pytest.mark.parametrize(
    ("write", "match"),
    [
        *(
            (
                lambda path, value=value: hdr(path, spoilt(value)),
                "got 1 pixels with NaN, infinite or negative",
            )
            for value in (np.nan, np.inf, -1.0)
        ),
        (lambda path: hdr(path, np.zeros((16, 32, 3))), "got a black one"),
        (lambda path: hdr(path, np.ones((20, 32, 3))), "twice as wide as high; got 32 x 20"),
        (lambda path: hdr(path, np.ones((16, 32, 1))), "expected channels R, G and B; got Y"),
        (lambda path: None, "nothing of that name"),
        (lambda path: path.write_text("not a panorama"), "something else. Convert it"),
    ],
)
def test_what_is_no_panorama_is_refused(write: Callable[[Path], object], match: str, tmp_path: Path) -> None:
    write(tmp_path / "a.exr")
    refused(tmp_path / "a.exr", match, read_panorama)


@pytest.mark.parametrize("name", ["c.hdr", "c.exr"])
def test_truncated_panoramas_are_refused(name: str, tmp_path: Path) -> None:
    radiance = np.random.default_rng(6).uniform(0, 9, (16, 32, 3))
    data = hdr(tmp_path / name, radiance).read_bytes()
    for share in (0.1, 0.5, 0.9):
        (tmp_path / name).write_bytes(data[: int(share * len(data))])
        refused(tmp_path / name, "expected a whole HDR panorama; got a damaged one", read_panorama)
