"""Colour and depth: whatever way a file states them, the same light comes out."""

import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
from PIL import Image, ImageCms

from tests.vig.photo.pictures import SIZE, chrm, cicp, flat, gama, is_light, png, profile, refused, tiff
from vig.photo.colour import HLG, PQ, REC709, SRGB, coded_encoding, rec709_from, tone_mapped
from vig.photo.decoding import MID_GREY
from vig.photo.images import as_photo, coded_photo, read_photo
from vig.scene.light import linear_from_srgb

ADOBE_WHITE_FIRST = (0.3127, 0.329, 0.64, 0.33, 0.21, 0.71, 0.15, 0.06)
SRGB_WHITE_FIRST = (0.3127, 0.329, 0.64, 0.33, 0.3, 0.6, 0.15, 0.06)
# The published matrices of Adobe RGB (1998) to XYZ and of XYZ to sRGB, both for D65.
XYZ_OF_ADOBE = [[0.57673, 0.18556, 0.18819], [0.29738, 0.62735, 0.07527], [0.02703, 0.07069, 0.99111]]
SRGB_OF_XYZ = [[3.24045, -1.53714, -0.49853], [-0.96927, 1.87601, 0.04156], [0.05564, -0.20403, 1.05723]]
PQ_OF_HALF_WHITE = 0.5096
"""SMPTE ST 2084 of 101.5 cd/m2, half of diffuse white's 203, with y = .01015 ^ .1593017578:
((.8359375 + 18.8515625 y) / (1 + 18.6875 y)) ^ 78.84375."""


def srgb(byte: float) -> float:
    return float(linear_from_srgb(np.array(byte / 255)))


@pytest.mark.parametrize("name", ["RGB", "RGBA", "L", "RGB.jpg", "L.jpg", "P"])
def test_common_photos_keep_their_bytes(name: str, tmp_path: Path) -> None:
    mode, _, ending = name.partition(".")
    noise = Image.fromarray(np.random.default_rng(0).integers(0, 256, (40, 50, 3), dtype=np.uint8)).convert(
        mode
    )
    path = tmp_path / f"a.{ending or 'png'}"
    noise.save(path)
    bytes_of_pillow = np.asarray(Image.open(path).convert("RGB"))
    for photo in (path, Image.open(path)):
        found = coded_photo(photo)
        assert found.dtype == np.uint8
        np.testing.assert_array_equal(found, bytes_of_pillow)


@pytest.mark.parametrize(
    ("pixels", "kind", "chunks", "light"),
    [
        (flat(128, 64, 200), 2, (), (128 / 255, 64 / 255, 200 / 255)),
        (flat(3000, 640, 20000, dtype=np.uint16), 2, (), (3000 / 65535, 640 / 65535, 20000 / 65535)),
        (flat(64), 0, (), 64 / 255),
        (flat(6400, dtype=np.uint16), 0, (), 6400 / 65535),
        (flat(64, 51), 4, (), 0.2 * 64 / 255 + 0.8 * MID_GREY),
        (flat(6400, 13107, dtype=np.uint16), 4, (), 0.2 * 6400 / 65535 + 0.8 * MID_GREY),
        (flat(64, 64, 64, 51), 6, (), 0.2 * 64 / 255 + 0.8 * MID_GREY),
        (flat(6400, 6400, 6400, 13107, dtype=np.uint16), 6, (), 0.2 * 6400 / 65535 + 0.8 * MID_GREY),
        (flat(0), 3, ((b"PLTE", bytes([64, 128, 32])),), (64 / 255, 128 / 255, 32 / 255)),
    ],
)
def test_linear_png_of_every_kind(
    pixels: np.ndarray, kind: int, chunks: tuple[tuple[bytes, bytes], ...], light: float, tmp_path: Path
) -> None:
    """gAMA of 1: samples are light."""
    is_light(read_photo(png(tmp_path / "a.png", pixels, kind, gama(1), *chunks)), light, 1e-5)


def test_gamma_and_primaries_of_png(tmp_path: Path) -> None:
    colour = np.array([120, 140, 100]) / 255
    pixels = flat(120, 140, 100)
    is_light(read_photo(png(tmp_path / "a.png", pixels, 2, gama(0.55))), colour ** (1 / 0.55), 1e-5)
    adobe = read_photo(png(tmp_path / "b.png", pixels, 2, gama(0.45455), chrm(*ADOBE_WHITE_FIRST)))
    is_light(adobe, np.array(SRGB_OF_XYZ) @ XYZ_OF_ADOBE @ colour**2.2)
    for chunks in [(gama(0.45455),), (gama(0.45455), chrm(*SRGB_WHITE_FIRST)), (chrm(*[0.3] * 8),)]:
        assert coded_photo(png(tmp_path / "c.png", pixels, 2, *chunks)).dtype == np.uint8  # sRGB, as it was


def test_of_several_statements_of_png_the_strongest_counts(tmp_path: Path) -> None:
    """cICP before iCCP before sRGB before gAMA and cHRM."""
    pixels, linear = flat(128, 128, 128), (b"iCCP", b"x\0\0" + zlib.compress(profile(b"RGB ", 1)))
    is_srgb = (b"sRGB", b"\0")
    is_light(read_photo(png(tmp_path / "a.png", pixels, 2, is_srgb, gama(1))), srgb(128))
    is_light(read_photo(png(tmp_path / "b.png", pixels, 2, linear, gama(0.5))), 128 / 255)
    is_light(read_photo(png(tmp_path / "c.png", pixels, 2, cicp(1, 13), linear, gama(1))), srgb(128))
    is_light(read_photo(png(tmp_path / "d.png", pixels, 2, cicp(1, 8), is_srgb, gama(0.3))), 128 / 255)


@pytest.mark.parametrize("primaries", [1, 9, 12])
def test_hdr_png(primaries: int, tmp_path: Path) -> None:
    sample = round(65535 * PQ_OF_HALF_WHITE)
    deep = flat(sample, sample, sample, dtype=np.uint16)
    is_light(read_photo(png(tmp_path / "a.png", deep, 2, cicp(primaries, PQ))), 0.5, 1e-3)
    is_light(
        read_photo(png(tmp_path / "b.png", (deep >> 8).astype(np.uint8), 2, cicp(primaries, PQ))), 0.5, 0.02
    )
    is_light(read_photo(png(tmp_path / "c.png", deep[..., :1], 0, cicp(primaries, PQ))), 0.5, 1e-3)
    # HLG puts diffuse white at 75 %; at 50 % the scene's light is 1/12, the display's its power of 1.2.
    for signal, light in ((0.75, 1.0), (0.5, 1000 / 203 * (1 / 12) ** 1.2)):
        sample = round(65535 * signal)
        pixels = flat(sample, sample, sample, dtype=np.uint16)
        is_light(read_photo(png(tmp_path / "d.png", pixels, 2, cicp(primaries, HLG))), light, 2e-3)


def test_narrow_range_and_unknown_codes_of_png(tmp_path: Path) -> None:
    narrow = read_photo(png(tmp_path / "a.png", flat(16, 235, 126), 2, cicp(1, 13, False)))
    is_light(narrow, (0, 1, float(linear_from_srgb(np.array(110 / 219)))), 1e-5)
    deep = flat(16 << 8, 235 << 8, 126 << 8, dtype=np.uint16)
    is_light(read_photo(png(tmp_path / "b.png", deep, 2, cicp(1, 13, False))), narrow[0, 0], 1e-4)
    refused(png(tmp_path / "c.png", flat(1, 2, 3), 2, cicp(1, 9)), "got primaries 1 and transfer 9 of H.273")


@pytest.mark.parametrize("space", [b"GRAY", b"RGB "])
@pytest.mark.parametrize(
    ("ending", "mode"),
    [
        *(("png", mode) for mode in ("L", "LA", "RGB", "RGBA", "P")),
        *(("tif", mode) for mode in ("L", "LA", "RGB", "RGBA", "P")),
        *(("jpg", mode) for mode in ("L", "RGB")),
        *(("webp", mode) for mode in ("RGB", "RGBA")),
    ],
)
def test_profiles_of_every_mode(space: bytes, mode: str, ending: str, tmp_path: Path) -> None:
    """A linear profile: samples are light, also where a grey picture has a profile for RGB and vice versa."""
    value: object = {"L": 64, "P": 0}.get(mode, (64,) * len(mode.rstrip("A")) + (255,) * mode.endswith("A"))
    if mode == "LA":
        value = (64, 51)
    picture = Image.new(mode, SIZE, value)  # type: ignore[arg-type]
    if mode == "P":
        picture.putpalette([64, 64, 64])
    options = {"lossless": True} if ending == "webp" else {}
    picture.save(tmp_path / f"a.{ending}", icc_profile=profile(space, 1), **options)
    light = 64 / 255 if mode != "LA" else 0.2 * 64 / 255 + 0.8 * MID_GREY
    is_light(read_photo(tmp_path / f"a.{ending}"), light)


@pytest.mark.parametrize("space", [b"GRAY", b"RGB "])
def test_profiles_of_16_bits(space: bytes, tmp_path: Path) -> None:
    chunk = b"iCCP", b"x\0\0" + zlib.compress(profile(space, 1))
    is_light(read_photo(png(tmp_path / "a.png", flat(6400, dtype=np.uint16), 0, chunk)), 6400 / 65535)
    colour = flat(6400, 12800, 25600, dtype=np.uint16)
    is_light(read_photo(png(tmp_path / "b.png", colour, 2, chunk)), colour[0, 0] / 65535)


def test_hdr_profiles_are_known_by_their_tag_and_name(tmp_path: Path) -> None:
    """Their curve, applied in 8 bits, would leave a photo nearly black."""
    sample = round(255 * PQ_OF_HALF_WHITE)
    picture = Image.new("RGB", SIZE, (sample,) * 3)
    for data in (profile(b"RGB ", 1, cicp=bytes([9, 16, 0, 1])), profile(b"RGB ", 1, b"ITUR_2100_PQ_FULL")):
        picture.save(tmp_path / "a.png", icc_profile=data)
        is_light(read_photo(tmp_path / "a.png"), 0.5, 0.02)


def test_lab_is_converted(tmp_path: Path) -> None:
    picture = Image.new("RGB", SIZE, (200, 60, 30))
    lab = ImageCms.profileToProfile(
        picture, ImageCms.createProfile("sRGB"), ImageCms.createProfile("LAB"), outputMode="LAB"
    )
    assert lab is not None
    lab.save(tmp_path / "a.tif")
    is_light(read_photo(tmp_path / "a.tif"), (srgb(200), srgb(60), srgb(30)), 0.01)


def test_cameras_state_adobe_rgb_in_exif_alone(tmp_path: Path) -> None:
    picture = Image.new("RGB", SIZE, (120, 140, 100))
    exif = picture.getexif()
    exif.get_ifd(0x8769)[0xA005] = {1: "R03"}
    picture.save(tmp_path / "a.jpg", exif=exif, quality=100, subsampling=0)
    colour = (np.array([120, 140, 100]) / 255) ** (563 / 256)
    is_light(read_photo(tmp_path / "a.jpg"), np.array(SRGB_OF_XYZ) @ XYZ_OF_ADOBE @ colour, 0.01)


@pytest.mark.parametrize("bits", [10, 12, 14])
@pytest.mark.parametrize("order", ["<", ">"])
def test_samples_count_by_their_true_range(bits: int, order: str, tmp_path: Path) -> None:
    """Half of full scale, in 16 bits each with the largest sample stated: one channel or three."""
    largest, half = 2**bits - 1, float(linear_from_srgb(np.array(2 ** (bits - 1) / (2**bits - 1))))
    sample = 2 ** (bits - 1)
    for tag in (281, 341):  # MaxSampleValue, SMaxSampleValue
        grey = flat(sample, dtype=np.uint16)
        is_light(read_photo(tiff(tmp_path / "a.tif", (grey, {tag: largest}), order=order)), half, 1e-5)
        colour = flat(sample, sample, sample, dtype=np.uint16), {tag: (largest,) * 3}
        is_light(read_photo(tiff(tmp_path / "b.tif", colour, order=order)), half, 1e-5)
    (tmp_path / "c.pgm").write_bytes(b"P5 24 20 %d\n" % largest + struct.pack(">H", sample) * 480)
    is_light(read_photo(tmp_path / "c.pgm"), half, 1e-3)
    (tmp_path / "d.ppm").write_bytes(b"P6 24 20 %d\n" % largest + struct.pack(">H", sample) * 1440)
    is_light(read_photo(tmp_path / "d.ppm"), half, 3e-3)


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("bits", [9, 10, 12, 14, 15])
@pytest.mark.parametrize("channels", [1, 3])
def test_packed_samples_are_named_where_pillow_does_not_unpack_them(
    bits: int, order: str, channels: int, tmp_path: Path
) -> None:
    largest, rng = 2**bits - 1, np.random.default_rng(bits)
    samples = rng.integers(0, largest + 1, (20, 24, channels))
    rows = ("".join(f"{sample:0{bits}b}" for sample in row.flat) for row in samples)
    data = b"".join(int(row, 2).to_bytes(len(row) // 8, "big") for row in rows)
    tags = {258: (bits,) * channels, 262: 2 if channels > 1 else 1, 277: channels}
    path = tiff(tmp_path / "a.tif", (data, tags), order=order)
    if (bits, order, channels) == (12, "<", 1):
        is_light(read_photo(path), linear_from_srgb(samples / largest), 1e-4)
    else:
        refused(path, f"a TIFF of samples of {bits} bits")


def test_16_bits_that_are_not_filled_are_refused(tmp_path: Path) -> None:
    refused(
        png(tmp_path / "a.png", flat(3000, dtype=np.uint16), 0), "16-bit samples; got none above 3000. Are"
    )
    refused(png(tmp_path / "b.png", flat(900, 900, 900, dtype=np.uint16), 2), "got none above 768")
    for largest in (8191, 16383, 32767):  # saturated
        refused(png(tmp_path / "a.png", flat(largest, dtype=np.uint16), 0), f"got none above {largest}")
        read_photo(png(tmp_path / "a.png", flat(largest + 1, dtype=np.uint16), 0))
    black = read_photo(png(tmp_path / "c.png", flat(0, dtype=np.uint16), 0))
    is_light(black, 0)


@pytest.mark.parametrize("order", ["<", ">"])
def test_white_may_be_zero(order: str, tmp_path: Path) -> None:
    is_light(read_photo(tiff(tmp_path / "a.tif", (flat(200), {262: 0}), order=order)), srgb(55))
    deep = tiff(tmp_path / "b.tif", (flat(60000, dtype=np.uint16), {262: 0}), order=order)
    if order == "<":
        is_light(read_photo(deep), float(linear_from_srgb(np.array(5535 / 65535))), 1e-5)
    else:
        refused(deep, "a TIFF of samples of 16 bits, 0 for white")


@pytest.mark.parametrize(
    ("dtype", "sample_format", "kind"),
    [
        (np.float32, 3, "floating-point samples of 32 bits"),
        (np.int16, 2, "signed samples of 16 bits"),
        (np.uint32, 1, "samples of 32 bits"),
    ],
)
@pytest.mark.parametrize("channels", [1, 3])
def test_samples_that_are_not_read_are_named(
    dtype: type, sample_format: int, kind: str, channels: int, tmp_path: Path
) -> None:
    pixels = flat(*[1] * channels, dtype=dtype), {339: (sample_format,) * channels}
    refused(tiff(tmp_path / "a.tif", pixels), kind)


def test_transparent_colours_of_few_and_many_bits(tmp_path: Path) -> None:
    key = (b"tRNS", struct.pack(">H", 6400))
    is_light(read_photo(png(tmp_path / "a.png", flat(6400, dtype=np.uint16), 0, key)), MID_GREY)
    colours = (b"tRNS", struct.pack(">3H", 6400, 7000, 8000))
    is_light(
        read_photo(png(tmp_path / "b.png", flat(6400, 7000, 8000, dtype=np.uint16), 2, colours)), MID_GREY
    )
    data = bytearray(png(tmp_path / "c.png", flat(0x55)[:, :6], 0, (b"tRNS", b"\0\1")).read_bytes())
    header = struct.pack(">IIBBBBB", 24, 20, 2, 0, 0, 0, 0)  # two bits: four pixels of 1 in each byte
    data[16 : 16 + 17] = header + struct.pack(">I", zlib.crc32(b"IHDR" + header))
    (tmp_path / "c.png").write_bytes(data)
    is_light(read_photo(tmp_path / "c.png"), MID_GREY)


@pytest.mark.parametrize("codes", [(1, PQ), (9, PQ), (9, HLG)])
def test_hdr_avif(codes: tuple[int, int], tmp_path: Path) -> None:
    signal = {PQ: PQ_OF_HALF_WHITE, HLG: 0.6133}[codes[1]]
    Image.new("RGB", (64, 48), (round(255 * signal),) * 3).save(tmp_path / "a.avif", quality=100)
    data = (tmp_path / "a.avif").read_bytes()
    assert data.count(b"colrnclx\0\1\0\r") == 1  # as sRGB
    path = tmp_path / "b.avif"
    path.write_bytes(data.replace(b"colrnclx\0\1\0\r", b"colrnclx" + struct.pack(">HH", *codes)))
    for photo in (read_photo(path), as_photo(Image.open(path))):
        if codes[1] == PQ:
            is_light(photo, 0.5, 0.02)
        else:  # the scene's light: (exp((.6133 - .55991) / .178833) + .284669) / 12 = .136
            is_light(photo, 0.136**1.2 * 1000 / 203, 0.02)
    assert coded_photo(tmp_path / "a.avif").dtype == np.uint8


def test_hdr_and_wide_heic(tmp_path: Path) -> None:
    heif = pytest.importorskip("pillow_heif")
    for codes, signal, light in (((9, PQ), PQ_OF_HALF_WHITE, 0.5), ((1, PQ), PQ_OF_HALF_WHITE, 0.5)):
        sample = np.full((48, 64, 3), round(65535 * signal), np.uint16)
        picture = heif.from_bytes("RGB;16", (64, 48), sample.tobytes())
        picture.save(
            tmp_path / "a.jpg.heic", quality=-1, chroma=444, color_primaries=codes[0],
            transfer_characteristics=codes[1], matrix_coefficients=1, full_range_flag=1,
        )  # fmt: skip
        is_light(read_photo(tmp_path / "a.jpg.heic"), light, 0.02)


def test_rec_709_stays_and_white_stays_white() -> None:
    np.testing.assert_allclose(rec709_from(REC709), np.eye(3), atol=1e-12)
    aces = (0.7347, 0.2653, 0, 1, 0.0001, -0.077, 0.32168, 0.33767)
    np.testing.assert_allclose(rec709_from(aces) @ np.ones(3), np.ones(3), atol=1e-12)
    # The published matrix of ACES AP0 to linear sRGB with Bradford's adaptation.
    published = [[2.5217, -1.1341, -0.3876], [-0.2765, 1.3727, -0.0963], [-0.0154, -0.1530, 1.1683]]
    np.testing.assert_allclose(rec709_from(aces), published, atol=2e-3)
    for spoilt in ([0] * 8, [np.nan] * 8, [0.3, 0.3] * 4, [0.64, 0.33, 0.3, 0.6, 0.15, 0.06, 0.3, 0]):
        with pytest.raises(ValueError, match="no colour space"):
            rec709_from(spoilt)


def test_tone_mapping_keeps_what_is_no_hdr_and_maps_the_peak_to_white() -> None:
    light = np.random.default_rng(0).uniform(0, 1, (9, 9, 3)).astype(np.float32)
    np.testing.assert_allclose(tone_mapped(light, 1.0), light, atol=1e-6)
    # The largest channel 2 of a peak of 4: 2 (1 + 2/16) / 3 = .75; the hue stays.
    np.testing.assert_allclose(tone_mapped(np.array([[2.0, 1.0, 0.5]]), 4.0), [[0.75, 0.375, 0.1875]])
    np.testing.assert_allclose(tone_mapped(np.array([[4.0, 0, 0], [9, 9, 9]]), 4.0), [[1, 0, 0], [1, 1, 1]])


def test_codes() -> None:
    assert coded_encoding(1, 13) is None is coded_encoding(2, 2)
    assert coded_encoding(12, 13) is not None
    np.testing.assert_allclose(SRGB.light(flat(128, 128, 128), 255), srgb(128), atol=1e-6)
    with pytest.raises(ValueError, match="transfer 11"):
        coded_encoding(1, 11)
