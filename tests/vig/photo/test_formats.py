"""What a file is: photos of several pictures, and what is no photo, by content."""

import struct
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from tests.vig.photo.pictures import SIZE, flat, png, refused, tiff
from vig.photo import focal_of, formats
from vig.photo.formats import why_no_photo
from vig.photo.images import read_photo

THUMBNAIL, PICTURE = np.full((20, 24, 3), 30, np.uint8), np.full((60, 80, 3), 128, np.uint8)
LINEAR_128 = 0.21586
FTYP = b"\0\0\0\x18ftyp"


def is_picture(path: Path) -> None:
    photo = read_photo(path)
    assert photo.shape == (60, 80, 3)
    np.testing.assert_allclose(photo, LINEAR_128, atol=0.01)


@pytest.mark.parametrize("order", ["<", ">"])
def test_of_pages_the_largest_is_taken(order: str, tmp_path: Path) -> None:
    other = np.full((60, 80, 3), 9, np.uint8)
    is_picture(tiff(tmp_path / "a.tif", (THUMBNAIL, {254: 1}), (PICTURE, {}), (other, {}), order=order))
    is_picture(tiff(tmp_path / "b.tif", (PICTURE, {}), (THUMBNAIL, {}), order=order))
    mask = np.full((90, 120, 3), 255, np.uint8)  # larger, and no picture
    is_picture(tiff(tmp_path / "c.tif", (mask, {254: 4}), (PICTURE, {}), order=order))


def test_pages_below_others_count(tmp_path: Path) -> None:
    """A thumbnail whose picture is in a SubIFD: the second page, taken out of the row of pages."""
    path = tiff(tmp_path / "a.tif", (THUMBNAIL, {254: 1, 330: 0}), (PICTURE, {}))
    data = bytearray(path.read_bytes())
    count = struct.unpack_from("<H", data, 8)[0]
    (second,) = struct.unpack_from("<I", data, 10 + 12 * count)
    for entry in range(10, 10 + 12 * count, 12):
        if struct.unpack_from("<H", data, entry)[0] == 330:
            struct.pack_into("<I", data, entry + 8, second)
    struct.pack_into("<I", data, 10 + 12 * count, 0)
    path.write_bytes(data)
    is_picture(path)


def test_huge_pages_are_refused_by_their_tags(tmp_path: Path) -> None:
    path = tiff(
        tmp_path / "a.tif", (THUMBNAIL, {}), (b"", {256: 60_000, 257: 60_000, 258: (8, 8, 8), 277: 3})
    )
    refused(path, "at most 250 megapixels; got 60000 x 60000")


def test_of_a_jpeg_of_several_pictures_the_largest_is_taken(tmp_path: Path) -> None:
    small, large = Image.fromarray(THUMBNAIL), Image.fromarray(PICTURE)
    for number, (first, second) in enumerate([(small, large), (large, small)]):
        path = tmp_path / f"{number}.jpg"
        first.save(path, format="MPO", save_all=True, append_images=[second])
        is_picture(path)


@pytest.mark.parametrize("ending", ["gif", "png", "webp", "avif"])
def test_of_an_animation_the_first_frame_is_taken(ending: str, tmp_path: Path) -> None:
    frames = [Image.fromarray(PICTURE), Image.fromarray(PICTURE // 4)]
    frames[0].save(tmp_path / f"a.{ending}", save_all=True, append_images=frames[1:])
    is_picture(tmp_path / f"a.{ending}")


@pytest.mark.parametrize("orientation", range(1, 9))
@pytest.mark.parametrize("kind", ["L", "RGB", "I;16"])
def test_tiff_of_every_orientation(orientation: int, kind: str, tmp_path: Path) -> None:
    """A bright corner at the top left of what is stored, 24 x 20; EXIF's table says where it belongs."""
    pixels = np.zeros((20, 24, 3 if kind == "RGB" else 1), np.uint16 if kind == "I;16" else np.uint8)
    pixels[:8, :8] = np.iinfo(pixels.dtype).max
    photo = read_photo(tiff(tmp_path / "a.tif", (pixels, {274: orientation})))
    row, column = {1: (0, 0), 2: (0, 1), 3: (1, 1), 4: (1, 0), 5: (0, 0), 6: (0, 1), 7: (1, 1), 8: (1, 0)}[
        orientation
    ]
    height, width = (20, 24) if orientation < 5 else (24, 20)
    expected = np.zeros((height, width, 3), np.float32)
    expected[row * (height - 8) : row * (height - 8) + 8, column * (width - 8) : column * (width - 8) + 8] = 1
    np.testing.assert_array_equal(photo, expected)


@pytest.mark.parametrize(
    ("name", "data", "kind"),
    [
        ("a.jpg", b"%PDF-1.7\n", "a PDF document. Save its picture"),
        ("a.png", b"8BPS\0\1", "a Photoshop document"),
        ("a.jpg", b"\xff\x0a\xfa\x7f", "JPEG XL. Convert"),
        ("a.jxl", b"\0\0\0\x0cJXL \r\n\x87\n", "JPEG XL"),
        ("a.png", b"<?xml version='1.0'?>\n<svg xmlns='x'/>", "a drawing \\(SVG\\)"),
        ("a.jpg", b"\n<!DOCTYPE html><html>", "a web page"),
        ("a.jpg", FTYP + b"isom\0\0\0\0mp41", "a video. Give vig fit"),
        ("a.jpg", FTYP + b"qt  \0\0\0\0qt  ", "a video"),
        ("a.png", b"\x1aE\xdf\xa3 webm", "a video"),
        ("a.npy", b"\x93NUMPY\1\0", "an array of numpy"),
        ("a.jpg", b"PK\3\4", "an archive"),
        ("._a.jpg", b"\0\5\x16\7\0\2\0\0Mac OS X", "a side file of macOS"),
        ("a.dcm", bytes(128) + b"DICM", "a DICOM file"),
        ("a.jpg", b"version https://git-lfs.github.com/spec/v1\n", "a pointer of Git LFS"),
        ("a.pfm", b"PF\n24 20\n-1\n", "an HDR image \\(PFM\\)"),
        ("a.cr3", FTYP + b"crx \0\0\0\1crx ", "a camera's raw file \\(CR3\\). Develop it"),
        ("a.jpg", FTYP + b"crx \0\0\0\1crx ", "a camera's raw file"),
        ("a.orf", b"IIRO\x08\0\0\0", "a camera's raw file \\(ORF\\)"),
        ("a.rw2", b"IIU\0\x08\0\0\0", "a camera's raw file \\(RW2\\)"),
        ("a.raf", b"FUJIFILMCCD-RAW 0201", "a camera's raw file \\(RAF\\)"),
        ("a.mrw", b"\0MRM\0\0", "a camera's raw file \\(MRW\\)"),
        ("a.x3f", b"FOVb\0\0", "a camera's raw file \\(X3F\\)"),
        ("a.kdc", b"nobody knows", "a camera's raw file \\(KDC\\)"),
        ("a.exr", b"v/1\1", "an HDR image"),
        ("a.eps", b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 50 50\nshowpage\n", "a PostScript drawing"),
        ("a.txt", b"this is not a picture", "something else. Convert it to JPEG or PNG"),
    ],
)
def test_what_is_no_photo_is_named(name: str, data: bytes, kind: str, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(data + bytes(200))
    refused(tmp_path / name, f"expected a photo .*; got {kind}")
    assert (why_no_photo(tmp_path / name) is None) == kind.startswith("something else")


@pytest.mark.parametrize("ending", ["dng", "tif", "nef", "arw", "cr2", "pef"])
def test_raw_files_are_no_photos_though_their_previews_are(ending: str, tmp_path: Path) -> None:
    """By the version of DNG, by a page of a sensor's mosaic, or by its ending."""
    mosaic = (np.full((60, 80, 1), 900, np.uint16), {262: formats.CFA})
    refused(tiff(tmp_path / f"a.{ending}", (THUMBNAIL, {254: 1}), mosaic), "a camera's raw file")
    refused(tiff(tmp_path / f"b.{ending}", (THUMBNAIL, {50706: 1})), "a camera's raw file")
    alone = tiff(tmp_path / f"c.{ending}", (THUMBNAIL, {}))
    if ending == "tif":
        assert read_photo(alone).shape == (20, 24, 3)
    else:
        refused(alone, "a camera's raw file")


def test_jpeg_of_rare_kinds_is_named(tmp_path: Path) -> None:
    Image.new("RGB", SIZE).save(tmp_path / "a.jpg")
    data = bytearray((tmp_path / "a.jpg").read_bytes())
    frame = data.index(b"\xff\xc0")
    data[frame + 4] = 12
    (tmp_path / "a.jpg").write_bytes(data)
    refused(tmp_path / "a.jpg", "got a JPEG of 12 bits. Convert")
    data[frame + 1], data[frame + 4] = 0xC3, 16
    (tmp_path / "a.jpg").write_bytes(data)
    refused(tmp_path / "a.jpg", "got a JPEG of 16 bits in a rare coding")


def test_photos_by_another_name_are_photos(tmp_path: Path) -> None:
    png(tmp_path / "a.dng", flat(1, 2, 3), 2)
    assert why_no_photo(tmp_path / "a.dng") is None and read_photo(tmp_path / "a.dng").shape == (20, 24, 3)


@pytest.mark.parametrize("name", ["a.heic", "a.jpg", "a"])
def test_heic_is_read_or_named(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    heif = pytest.importorskip("pillow_heif")
    picture = Image.fromarray(PICTURE)
    exif = picture.getexif()
    exif.get_ifd(0x8769)[0xA405] = 50
    heif.from_pillow(picture).save(tmp_path / "held.heic", exif=exif.tobytes())
    path = (tmp_path / "held.heic").rename(tmp_path / name)
    is_picture(path)
    assert focal_of(path) == pytest.approx(50 / 43.2666 * 100, rel=1e-4)
    path.write_bytes(path.read_bytes()[:-40])
    refused(path, "a damaged one")
    monkeypatch.setattr(formats, "find_spec", lambda _: None)
    refused(path, r"got HEIC\. Convert it to JPEG, or run pip install 'vig\[heic\]'\.")


def test_oblong_pixels_are_refused(tmp_path: Path) -> None:
    """As ffmpeg writes them for frames of anamorphic videos; an equal density without a unit is square."""
    for x, y in ((27, 32), (32, 27)):
        refused(
            png(tmp_path / "a.png", flat(1, 2, 3), 2, (b"pHYs", struct.pack(">IIB", x, y, 0))),
            f"square pixels; got oblong ones \\({x}:{y}\\)",
        )
    for extra in (struct.pack(">IIB", 300, 300, 0), struct.pack(">IIB", 2835, 2834, 1)):
        read_photo(png(tmp_path / "b.png", flat(1, 2, 3), 2, (b"pHYs", extra)))
    Image.new("RGB", SIZE).save(tmp_path / "c.jpg")
    data = bytearray((tmp_path / "c.jpg").read_bytes())
    place = data.index(b"JFIF") + 7
    for unit, x, y in ((0, 1, 1), (1, 72, 72), (0, 0, 0), (0, 1, 100)):
        data[place : place + 5] = struct.pack(">BHH", unit, x, y)
        (tmp_path / "c.jpg").write_bytes(data)
        read_photo(tmp_path / "c.jpg")
    data[place : place + 5] = struct.pack(">BHH", 0, 4, 3)
    (tmp_path / "c.jpg").write_bytes(data)
    refused(tmp_path / "c.jpg", "got oblong ones")
