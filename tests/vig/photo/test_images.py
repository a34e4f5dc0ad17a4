import io
import os
import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
from PIL import Image, ImageCms

from vig.io.errors import UserError
from vig.photo.checks import MAX_PIXELS
from vig.photo.decoding import MID_GREY
from vig.photo.images import png_bytes, read_photo, write_png
from vig.photo.lens import focal_of
from vig.photo.masks import read_mask
from vig_world.assets.hdr import read_panorama

SIZE = (24, 20)  # width, height
LINEAR_128 = 0.21586  # ((128/255 + 0.055) / 1.055) ** 2.4


def png(path: Path, width: int, height: int, bits: int, colour_type: int, rows: bytes) -> Path:
    """Write a PNG byte by byte: pillow cannot write every kind that it must read."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = struct.pack(">IIBBBBB", width, height, bits, colour_type, 0, 0, 0)
    body = chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b"")
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + body)
    return path


def refused(path: str | Path, match: str, read=read_photo) -> None:
    with pytest.raises(UserError, match=match) as caught:
        read(path)
    assert "\n" not in str(caught.value)


def is_colour(photo: np.ndarray, colour: tuple[float, ...], tolerance: float = 1e-4) -> None:
    assert photo.dtype == np.float32 and photo.shape == (SIZE[1], SIZE[0], 3)
    np.testing.assert_allclose(photo, np.broadcast_to(colour, photo.shape), atol=tolerance)


def test_rgb_is_decoded_to_linear_light(tmp_path: Path) -> None:
    Image.new("RGB", SIZE, (255, 128, 0)).save(tmp_path / "a.png")
    is_colour(read_photo(tmp_path / "a.png"), (1.0, LINEAR_128, 0.0))


@pytest.mark.parametrize("suffix", ["jpg", "webp", "tif", "bmp", "gif", "ppm", "jp2", "avif"])
def test_common_formats(tmp_path: Path, suffix: str) -> None:
    Image.new("RGB", SIZE, (128, 128, 128)).save(tmp_path / f"a.{suffix}")
    is_colour(read_photo(tmp_path / f"a.{suffix}"), (LINEAR_128,) * 3, 0.01)


@pytest.mark.parametrize("mode", ["L", "P"])
def test_grey_and_palette_become_rgb(tmp_path: Path, mode: str) -> None:
    Image.new("L", SIZE, 128).convert(mode).save(tmp_path / "a.png")
    is_colour(read_photo(tmp_path / "a.png"), (LINEAR_128,) * 3)


def test_one_bit_images_are_black_and_white(tmp_path: Path) -> None:
    Image.new("1", SIZE, 1).save(tmp_path / "a.png")
    is_colour(read_photo(tmp_path / "a.png"), (1.0, 1.0, 1.0))


@pytest.mark.parametrize(("alpha", "share"), [(255, 1.0), (0, 0.0), (51, 0.2)])
def test_alpha_is_laid_over_mid_grey_in_linear_light(tmp_path: Path, alpha: int, share: float) -> None:
    Image.new("RGBA", SIZE, (255, 0, 0, alpha)).save(tmp_path / "a.png")
    under = (1 - share) * MID_GREY
    is_colour(read_photo(tmp_path / "a.png"), (share + under, under, under))


def test_grey_with_alpha_and_transparent_palette(tmp_path: Path) -> None:
    Image.new("LA", SIZE, (255, 0)).save(tmp_path / "a.png")
    is_colour(read_photo(tmp_path / "a.png"), (MID_GREY,) * 3)
    palette = Image.new("P", SIZE, 3)
    palette.putpalette(range(12))
    palette.save(tmp_path / "b.png", transparency=3)
    is_colour(read_photo(tmp_path / "b.png"), (MID_GREY,) * 3)


def test_cmyk_is_converted(tmp_path: Path) -> None:
    # No ink in cyan, all of magenta and yellow, no black: pure red.
    Image.new("CMYK", SIZE, (0, 255, 255, 0)).save(tmp_path / "a.jpg", quality=100)
    is_colour(read_photo(tmp_path / "a.jpg"), (1.0, 0.0, 0.0), 0.02)


def test_sixteen_bit_grey_keeps_its_precision(tmp_path: Path) -> None:
    Image.fromarray(np.full(SIZE[::-1], 32768, np.uint16)).save(tmp_path / "a.png")
    level = ((32768 / 65535 + 0.055) / 1.055) ** 2.4
    is_colour(read_photo(tmp_path / "a.png"), (level,) * 3, 1e-6)


def test_sixteen_bit_rgb(tmp_path: Path) -> None:
    row = b"\0" + struct.pack(">HHH", 65535, 0x8080, 0) * SIZE[0]
    path = png(tmp_path / "a.png", *SIZE, 16, 2, row * SIZE[1])
    is_colour(read_photo(path), (1.0, LINEAR_128, 0.0))


def test_thirty_two_bits_are_refused(tmp_path: Path) -> None:
    Image.fromarray(np.ones(SIZE[::-1], np.float32)).save(tmp_path / "a.tif")
    refused(
        tmp_path / "a.tif", "expected 8 or 16 bits a channel; got floating-point samples of 32 bits. Save it"
    )


def test_exif_orientation_is_applied(tmp_path: Path) -> None:
    picture = Image.new("RGB", SIZE, (0, 0, 0))
    picture.paste((255, 255, 255), (0, 0, SIZE[0], 8))  # a white band at the top of what is stored
    exif = picture.getexif()
    exif[0x0112] = 6  # stored sideways: to be turned a quarter clockwise for viewing
    picture.save(tmp_path / "a.png", exif=exif)
    photo = read_photo(tmp_path / "a.png")
    assert photo.shape == (SIZE[0], SIZE[1], 3)
    assert (photo[:, -8:] == 1).all() and (photo[:, :-8] == 0).all()  # the band is now at the right


def test_unreadable_exif_and_colour_profile_are_ignored(tmp_path: Path) -> None:
    picture = Image.new("RGB", SIZE, (128, 128, 128))
    picture.save(tmp_path / "a.png", exif=b"Exif\0\0nonsense", icc_profile=b"nonsense")
    is_colour(read_photo(tmp_path / "a.png"), (LINEAR_128,) * 3)


def test_the_focal_length_is_read_from_exif(tmp_path: Path) -> None:
    """50 mm of a film whose diagonal is 43.27 mm, in pixels of a picture whose diagonal is 500."""
    picture = Image.new("RGB", (400, 300))
    exif = picture.getexif()
    exif.get_ifd(0x8769)[0xA405] = 50
    picture.save(tmp_path / "a.jpg", exif=exif)
    assert focal_of(tmp_path / "a.jpg") == pytest.approx(50 / 43.2666 * 500, rel=1e-4)
    assert focal_of(str(tmp_path / "a.jpg")) == focal_of(Image.open(tmp_path / "a.jpg"))


@pytest.mark.parametrize("told", [0, 65000, None])
def test_a_focal_length_that_is_none_is_not_read(tmp_path: Path, told: int | None) -> None:
    picture = Image.new("RGB", (400, 300))
    exif = picture.getexif()
    if told is not None:
        exif.get_ifd(0x8769)[0xA405] = told
    picture.save(tmp_path / "a.jpg", exif=exif)
    assert focal_of(tmp_path / "a.jpg") is None
    for other in (tmp_path / "nothing.jpg", np.zeros((20, 20, 3)), 7):
        assert focal_of(other) is None


def test_an_embedded_colour_profile_is_honoured(tmp_path: Path) -> None:
    profile = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
    Image.new("RGB", SIZE, (255, 0, 0)).save(tmp_path / "a.png", icc_profile=profile)
    is_colour(read_photo(tmp_path / "a.png"), (1.0, 0.0, 0.0), 0.01)
    # A colour space whose first primary is sRGB's green and whose second is its red.
    swapped = profile.replace(b"rXYZ", b"????").replace(b"gXYZ", b"rXYZ").replace(b"????", b"gXYZ")
    Image.new("RGB", SIZE, (255, 0, 0)).save(tmp_path / "b.png", icc_profile=swapped)
    is_colour(read_photo(tmp_path / "b.png"), (0.0, 1.0, 0.0), 0.01)


def test_of_an_animation_the_first_frame_is_taken(tmp_path: Path) -> None:
    frames = [Image.new("RGB", SIZE, (0, 255, 0)), Image.new("RGB", SIZE, (255, 0, 0))]
    frames[0].save(tmp_path / "a.gif", save_all=True, append_images=frames[1:])
    is_colour(read_photo(tmp_path / "a.gif"), (0.0, 1.0, 0.0))


def test_missing_folder_empty_and_foreign_files_are_refused(tmp_path: Path) -> None:
    (tmp_path / "empty.png").touch()
    (tmp_path / "text.png").write_text("this is not a picture")
    refused(tmp_path / "no.png", r"no\.png: expected an image file; got nothing of that name. Check the path")
    refused(tmp_path, "expected an image file; got a folder. Name the files in it")
    refused(tmp_path / "empty.png", "got an empty file")
    refused(tmp_path / "text.png", "expected a photo .*; got something else. Convert it to JPEG or PNG")
    refused(tmp_path / "empty.png" / "a.png", "expected a.* image file")


def test_pipes_are_refused_without_waiting(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.png")
    refused(tmp_path / "pipe.png", "a device or pipe")


def test_vector_files_are_not_run(tmp_path: Path) -> None:
    (tmp_path / "a.eps").write_text("%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 50 50\nshowpage\n")
    refused(tmp_path / "a.eps", "got a PostScript drawing. Save it as PNG")


@pytest.mark.parametrize("suffix", ["png", "jpg", "webp", "gif", "tif"])
@pytest.mark.parametrize("share", [0.3, 0.6, 0.9])
def test_truncated_files_are_refused(tmp_path: Path, suffix: str, share: float) -> None:
    noise = np.random.default_rng(0).integers(0, 256, (64, 64, 3), dtype=np.uint8)
    buffer = io.BytesIO()
    Image.fromarray(noise).save(buffer, format={"jpg": "JPEG", "tif": "TIFF"}.get(suffix, suffix))
    path = tmp_path / f"a.{suffix}"
    path.write_bytes(buffer.getvalue()[: int(share * len(buffer.getvalue()))])
    refused(path, "damaged|something else")


def test_damaged_bytes_are_refused(tmp_path: Path) -> None:
    Image.fromarray(np.random.default_rng(1).integers(0, 256, (64, 64, 3), dtype=np.uint8)).save(
        tmp_path / "a.png"
    )
    data = bytearray((tmp_path / "a.png").read_bytes())
    data[2000:2100] = bytes(100)
    (tmp_path / "a.png").write_bytes(data)
    refused(tmp_path / "a.png", "expected a whole photo; got a damaged one .* Save or copy it again")


@pytest.mark.parametrize("size", [(1, 1), (15, 400), (400, 1)])
def test_tiny_images_are_refused(tmp_path: Path, size: tuple[int, int]) -> None:
    Image.new("RGB", size).save(tmp_path / "a.png")
    refused(tmp_path / "a.png", f"expected at least 16 pixels a side; got {size[0]} x {size[1]}")


@pytest.mark.parametrize("side", [16_001, 60_000])
def test_huge_images_are_refused_by_their_header(tmp_path: Path, side: int) -> None:
    # The pixels are not even there: whoever decodes first fails with another message.
    path = png(tmp_path / "bomb.png", side, side, 8, 2, b"")
    assert side**2 > MAX_PIXELS
    for read in (read_photo, read_mask):
        refused(path, "expected at most 250 megapixels; got .* Make it smaller", read)
    assert focal_of(path) is None


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


def test_hdr_is_not_a_photo(tmp_path: Path) -> None:
    refused(hdr(tmp_path / "a.hdr", np.ones((16, 32, 3))), "got an HDR image. Save it as 8-bit sRGB")
    refused(hdr(tmp_path / "a.exr", np.ones((16, 32, 3))), "got an HDR image")


def test_written_floats_are_linear_light_and_come_back(tmp_path: Path) -> None:
    linear = np.random.default_rng(2).uniform(0, 1, (20, 30, 3)).astype(np.float32)
    write_png(tmp_path / "sub" / "a.png", linear)
    # Half a step of 8-bit sRGB is at most 0.5/255 x the steepest slope of the decoding, 2.4/1.055.
    np.testing.assert_allclose(read_photo(tmp_path / "sub" / "a.png"), linear, atol=0.5 / 255 * 2.4 / 1.055)


def test_bytes_and_masks_are_written_as_they_are(tmp_path: Path) -> None:
    picture = np.random.default_rng(3).integers(0, 256, (20, 30, 4), dtype=np.uint8)
    write_png(tmp_path / "a.png", picture)
    np.testing.assert_array_equal(np.asarray(Image.open(tmp_path / "a.png")), picture)
    write_png(tmp_path / "b.png", picture[..., 0] > 99)
    np.testing.assert_array_equal(np.asarray(Image.open(tmp_path / "b.png")) == 255, picture[..., 0] > 99)


@pytest.mark.parametrize(
    ("array", "match"),
    [
        (np.zeros((4, 4, 2)), r"\(4, 4, 2\)"),
        (np.zeros(4), r"\(4,\)"),
        (np.zeros((0, 4)), r"\(0, 4\)"),
        (np.full((4, 4), np.nan), "finite"),
        (np.zeros((4, 4, 4)), "alpha"),
        (np.zeros((4, 4), np.int64), "int64"),
    ],
)
def test_what_is_no_picture_is_not_written(tmp_path: Path, array: np.ndarray, match: str) -> None:
    with pytest.raises(ValueError, match=match):
        write_png(tmp_path / "a.png", array)
    assert not (tmp_path / "a.png").exists()


def hdr(path: Path, pixels: np.ndarray) -> Path:
    import OpenImageIO as oiio

    assert oiio.ImageBuf(np.ascontiguousarray(pixels, dtype=np.float32)).write(str(path))
    return path


def test_panoramas_come_back_as_written(tmp_path: Path) -> None:
    radiance = np.random.default_rng(4).uniform(0, 50, (16, 32, 3)).astype(np.float32)
    exr = read_panorama(hdr(tmp_path / "a.exr", radiance))
    assert exr.shape == (16, 32, 3) and exr.dtype == np.float32
    np.testing.assert_array_equal(exr, radiance)
    # Radiance's shared exponent: 8 bits below the largest channel, truncated.
    np.testing.assert_allclose(read_panorama(hdr(tmp_path / "a.hdr", radiance)), radiance, atol=50 / 128)


def test_of_more_channels_the_colours_are_taken(tmp_path: Path) -> None:
    rgba = np.random.default_rng(5).uniform(0, 1, (16, 32, 4)).astype(np.float32)
    np.testing.assert_array_equal(read_panorama(hdr(tmp_path / "a.exr", rgba)), rgba[..., :3])
    refused(hdr(tmp_path / "b.exr", rgba[..., :1]), "expected channels R, G and B; got Y", read_panorama)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -1.0])
def test_panoramas_with_impossible_radiance_are_refused(tmp_path: Path, bad: float) -> None:
    radiance = np.ones((16, 32, 3))
    radiance[3, 4, 1] = bad
    refused(
        hdr(tmp_path / "a.exr", radiance), "got 1 pixels with NaN, infinite or negative values", read_panorama
    )


def test_black_misshapen_truncated_and_foreign_panoramas_are_refused(tmp_path: Path) -> None:
    refused(hdr(tmp_path / "a.exr", np.zeros((16, 32, 3))), "got a black one", read_panorama)
    refused(
        hdr(tmp_path / "b.exr", np.ones((20, 32, 3))), "twice as wide as high; got 32 x 20", read_panorama
    )
    refused(tmp_path / "no.hdr", "nothing of that name", read_panorama)
    (tmp_path / "text.hdr").write_text("not a panorama")
    refused(tmp_path / "text.hdr", "something else. Convert it", read_panorama)
    noise = np.random.default_rng(6).uniform(0, 9, (16, 32, 3))
    for name in ("c.hdr", "c.exr"):
        data = hdr(tmp_path / name, noise).read_bytes()
        for share in (0.1, 0.5, 0.9):
            (tmp_path / name).write_bytes(data[: int(share * len(data))])
            refused(tmp_path / name, "expected a whole HDR panorama; got a damaged one", read_panorama)


def test_whatever_is_damaged_the_answer_is_a_picture_or_a_refusal(tmp_path: Path) -> None:
    rng = np.random.default_rng(8)
    Image.fromarray(rng.integers(0, 256, (24, 40, 3), dtype=np.uint8)).save(tmp_path / "a.png")
    hdr(tmp_path / "a.hdr", rng.uniform(0, 3, (16, 32, 3)))
    hdr(tmp_path / "a.exr", rng.uniform(0, 3, (16, 32, 3)))
    for name, read in (("a.png", read_photo), ("a.hdr", read_panorama), ("a.exr", read_panorama)):
        whole = (tmp_path / name).read_bytes()
        for _ in range(40):
            damaged = bytearray(whole)
            for place in rng.integers(0, 150, 5):  # headers are where decoders trip
                damaged[place] = rng.integers(0, 256)
            (tmp_path / name).write_bytes(damaged)
            try:
                assert np.isfinite(read(tmp_path / name)).all()
            except UserError as error:
                assert "\n" not in str(error)


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
def test_pillow_reads_what_was_written(shape: tuple[int, ...], dtype: type, mode: str) -> None:
    image = np.random.default_rng(0).integers(np.iinfo(dtype).max + 1, size=shape).astype(dtype)
    read = Image.open(io.BytesIO(png_bytes(image)))
    assert (read.format, read.mode) == ("PNG", mode)
    np.testing.assert_array_equal(np.asarray(read), image)


@pytest.mark.parametrize("picture", [np.zeros((4, 4), np.float32), np.zeros((0, 4), np.uint8)])
def test_what_is_no_picture_is_not_encoded(picture: np.ndarray) -> None:
    with pytest.raises(ValueError, match="Convert it"):
        png_bytes(picture)


def test_smooth_pictures_become_small() -> None:
    slope = np.add.outer(np.arange(150), np.arange(150)).astype(np.uint16) * 100
    assert len(png_bytes(slope)) < slope.nbytes / 10
