"""Panoramas of whatever order, primaries, windows, parts and layers; what is no RGB radiance is named."""

import struct
from pathlib import Path
from typing import Any

import numpy as np
import OpenImageIO as oiio
import pytest

from vig.io.errors import UserError
from vig_world.assets.hdr import read_panorama

HEIGHT, WIDTH = 16, 32
# Powers of two times small whole numbers: exact in Radiance's shared exponent and in half floats.
ROWS, COLUMNS = np.indices((HEIGHT, WIDTH), np.float32) + 1
UPRIGHT = np.stack([ROWS, COLUMNS, np.full_like(ROWS, 8)], -1)
AP0 = (0.7347, 0.2653, 0, 1, 0.0001, -0.077, 0.32168, 0.33767)
SRGB_OF_AP0 = [[2.5217, -1.1341, -0.3876], [-0.2765, 1.3727, -0.0963], [-0.0154, -0.1530, 1.1683]]
"""The published matrix, with Bradford's adaptation."""


def refused(path: Path, match: str) -> None:
    with pytest.raises(UserError, match=match) as caught:
        read_panorama(path)
    assert "\n" not in str(caught.value)


def radiance(path: Path, pixels: np.ndarray, order: str = "-Y {h} +X {w}", header: str = "") -> Path:
    """Write scanlines (lines, points, 3) as a flat Radiance file; `header` holds further lines."""
    largest = pixels.max(-1, keepdims=True)
    exponent = np.floor(np.log2(largest)) + 1
    rgbe = np.concatenate([pixels * 2.0 ** (8 - exponent), exponent + 128], -1).astype(np.uint8)
    resolution = order.format(h=HEIGHT, w=WIDTH)
    kind = "" if "FORMAT" in header else "FORMAT=32-bit_rle_rgbe\n"
    path.write_bytes(f"#?RADIANCE\n{header}{kind}\n{resolution}\n".encode() + rgbe.tobytes())
    return path


def exr(path: Path, pixels: np.ndarray, kind: Any = oiio.HALF, **attributes: Any) -> Path:
    """Write pixels (H, W, C) as OpenEXR: `names` of channels, data `window` (x, y), display window `full`."""
    height, width, channels = pixels.shape
    spec = oiio.ImageSpec(width, height, channels, kind)
    spec.channelnames = attributes.pop("names", ("R", "G", "B", "A", "Z", "N")[:channels])
    spec.x, spec.y = attributes.pop("window", (0, 0))
    full = attributes.pop("full", (spec.x, spec.y, width, height))
    spec.full_x, spec.full_y, spec.full_width, spec.full_height = full
    for name, value in attributes.items():
        if isinstance(value, tuple):
            spec.attribute(name, oiio.TypeDesc(f"float[{len(value)}]"), value)
        else:
            spec.attribute(name, value)
    target = oiio.ImageOutput.create(str(path))
    assert target.open(str(path), spec), target.geterror()
    target.write_image(np.ascontiguousarray(pixels))
    target.close()
    return path


@pytest.mark.parametrize("upward", [False, True])
@pytest.mark.parametrize("leftward", [False, True])
@pytest.mark.parametrize("columns", [False, True])
def test_radiance_files_of_all_eight_orders(
    upward: bool, leftward: bool, columns: bool, tmp_path: Path
) -> None:
    """`+Y` puts the bottom first, `-X` the right; X first makes each scanline a column."""
    lines = UPRIGHT[:: -1 if upward else 1, :: -1 if leftward else 1]
    y, x = ("+" if upward else "-") + "Y {h}", ("-" if leftward else "+") + "X {w}"
    path = radiance(
        tmp_path / "a.hdr",
        lines.transpose(1, 0, 2) if columns else lines,
        f"{x} {y}" if columns else f"{y} {x}",
    )
    np.testing.assert_array_equal(read_panorama(path), UPRIGHT)


def test_exposures_and_corrections_of_radiance_files_are_undone(tmp_path: Path) -> None:
    """They were multiplied in, one after the other; those of pictures that went into it are indented."""
    header = "EXPOSURE=2\npfilt -1\n\tEXPOSURE= 100\nEXPOSURE= 4\nCOLORCORR= 1 2 0.5\nVIEW= -vtv\n"
    path = radiance(tmp_path / "a.hdr", UPRIGHT, header=header)
    np.testing.assert_allclose(read_panorama(path), UPRIGHT / (8 * np.array([1, 2, 0.5])), rtol=1e-6)


def test_primaries_of_radiance_files(tmp_path: Path) -> None:
    flat = np.broadcast_to(np.float32([4, 2, 1]), UPRIGHT.shape)
    stated = "PRIMARIES= " + " ".join(map(str, AP0)) + "\n"
    found = read_panorama(radiance(tmp_path / "a.hdr", flat, header=stated))
    np.testing.assert_allclose(found, flat @ np.transpose(SRGB_OF_AP0), atol=0.02)


def test_what_is_no_linear_rgb_of_radiance_is_named(tmp_path: Path) -> None:
    refused(
        radiance(tmp_path / "a.hdr", UPRIGHT, header="FORMAT=32-bit_rle_xyze\n"), "got XYZE. Convert it with"
    )
    refused(radiance(tmp_path / "b.hdr", UPRIGHT, header="GAMMA=2.2\n"), "linear radiance; got GAMMA=2.2")
    refused(radiance(tmp_path / "c.hdr", UPRIGHT, header="EXPOSURE=bright\n"), "a damaged one")
    sideways = radiance(tmp_path / "d.hdr", UPRIGHT, "-Y {w} +X {h}")
    refused(sideways, "twice as wide as high; got 16 x 32")


def test_chromaticities(tmp_path: Path) -> None:
    flat = np.broadcast_to(np.float32([0.5, 0.25, 0.125]), UPRIGHT.shape)
    found = read_panorama(exr(tmp_path / "a.exr", flat, chromaticities=AP0))
    np.testing.assert_allclose(found, flat @ np.transpose(SRGB_OF_AP0), atol=2e-3)
    white = read_panorama(exr(tmp_path / "b.exr", UPRIGHT * 0 + 1, chromaticities=AP0))
    np.testing.assert_allclose(white, 1, atol=1e-5)
    red = np.broadcast_to(np.float32([1, 0, 0]), UPRIGHT.shape)  # outside Rec. 709: less than no green
    np.testing.assert_allclose(
        read_panorama(exr(tmp_path / "c.exr", red, chromaticities=AP0))[0, 0], [2.5217, 0, 0], atol=2e-3
    )
    same = (0.64, 0.33, 0.3, 0.6, 0.15, 0.06, 0.3127, 0.329)
    np.testing.assert_array_equal(
        read_panorama(exr(tmp_path / "d.exr", UPRIGHT, chromaticities=same)), UPRIGHT
    )
    refused(
        exr(tmp_path / "e.exr", UPRIGHT, chromaticities=(0.0,) * 8), "a colour space; got 0 0 0 0 0 0 0 0"
    )


@pytest.mark.parametrize(
    ("window", "full"),
    [
        ((0, 0), (0, 0, 64, 32)),  # a crop at the top left
        ((40, 20), (0, 0, 64, 32)),  # reaching beyond the right and the bottom
        ((-8, -4), (0, 0, 64, 32)),
        ((-8, -6), (0, 0, 32, 16)),  # overscan
        ((103, 57), (100, 50, 40, 20)),  # a display window elsewhere
    ],
)
def test_the_display_window_counts(
    window: tuple[int, int], full: tuple[int, int, int, int], tmp_path: Path
) -> None:
    """Pixel by pixel: its place in the display is its place in the data less where the display begins."""
    x, y, width, height = full
    expected = np.zeros((height, width, 3), np.float32)
    for row in range(HEIGHT):
        for column in range(WIDTH):
            down, right = row + window[1] - y, column + window[0] - x
            if 0 <= down < height and 0 <= right < width:
                expected[down, right] = UPRIGHT[row, column]
    found = read_panorama(exr(tmp_path / "a.exr", UPRIGHT, window=window, full=full))
    np.testing.assert_array_equal(found, expected)


def test_data_beside_the_display_window_are_none(tmp_path: Path) -> None:
    refused(exr(tmp_path / "a.exr", UPRIGHT, window=(99, 0), full=(0, 0, 64, 32)), "got a black one")
    refused(exr(tmp_path / "b.exr", UPRIGHT, full=(0, 0, 32, 32)), "twice as wide as high; got 32 x 32")


def test_channels_layers_and_parts(tmp_path: Path) -> None:
    both = np.concatenate([UPRIGHT * 0, UPRIGHT], -1)
    for names in [("a.X", "a.Y", "a.Z", "R", "G", "B"), ("a.R", "a.G", "Z", "r", "g", "b")]:
        np.testing.assert_array_equal(read_panorama(exr(tmp_path / "a.exr", both, names=names)), UPRIGHT)
    alone = exr(tmp_path / "b.exr", UPRIGHT, names=("beauty.R", "beauty.G", "beauty.B"))
    np.testing.assert_array_equal(read_panorama(alone), UPRIGHT)
    layers = exr(tmp_path / "c.exr", both, names=tuple(f"{layer}.{c}" for layer in "ab" for c in "RGB"))
    refused(layers, "one layer of R, G and B; got A, B. Export")
    specs = [oiio.ImageSpec(WIDTH, HEIGHT, channels, oiio.HALF) for channels in (1, 3)]
    specs[0].channelnames = ("Z",)
    for number, spec in enumerate(specs):
        spec.attribute("oiio:subimagename", f"part{number}")
    target = oiio.ImageOutput.create(str(tmp_path / "d.exr"))
    assert target.open(str(tmp_path / "d.exr"), specs)
    target.write_image(np.ascontiguousarray(UPRIGHT[..., :1]))
    assert target.open(str(tmp_path / "d.exr"), specs[1], "AppendSubimage")
    target.write_image(UPRIGHT)
    target.close()
    np.testing.assert_array_equal(read_panorama(tmp_path / "d.exr"), UPRIGHT)


def test_what_is_no_flat_rgb_of_openexr_is_named(tmp_path: Path) -> None:
    refused(
        exr(tmp_path / "a.exr", UPRIGHT.astype(np.uint32), oiio.UINT32), "half or float pixels; got integers"
    )
    cube = np.tile(UPRIGHT[:, :16], (6, 1, 1))
    refused(exr(tmp_path / "b.exr", cube, textureformat="CubeFace Environment"), "got a cube map")
    aces = exr(tmp_path / "c.exr", UPRIGHT, colorInteropID="lin_ap1_scene")
    if oiio.ImageInput.open(str(aces)).spec().getattribute("colorInteropID"):  # not in its first versions
        refused(aces, "linear Rec. 709 or chromaticities; got lin_ap1_scene")


def test_luminance_and_chroma_are_named_or_read(tmp_path: Path) -> None:
    """Y of 1 and no chroma, which is sampled half as often; some versions of OpenImageIO make RGB of it."""

    def attribute(name: str, kind: str, data: bytes) -> bytes:
        return name.encode() + b"\0" + kind.encode() + b"\0" + struct.pack("<I", len(data)) + data

    channels = b"".join(
        name + b"\0" + struct.pack("<iB3xii", 1, 0, step, step)
        for name, step in ((b"BY", 2), (b"RY", 2), (b"Y", 1))
    )
    window = struct.pack("<4i", 0, 0, WIDTH - 1, HEIGHT - 1)
    header = struct.pack("<II", 20000630, 2) + attribute("channels", "chlist", channels + b"\0")
    header += attribute("compression", "compression", b"\0") + attribute("lineOrder", "lineOrder", b"\0")
    header += attribute("dataWindow", "box2i", window) + attribute("displayWindow", "box2i", window)
    header += attribute("pixelAspectRatio", "float", struct.pack("<f", 1))
    header += attribute("screenWindowCenter", "v2f", bytes(8))
    header += attribute("screenWindowWidth", "float", struct.pack("<f", 1)) + b"\0"
    lines = []
    for row in range(HEIGHT):
        data = bytes(2 * WIDTH) * (row % 2 == 0) + np.ones(WIDTH, np.float16).tobytes()
        lines.append(struct.pack("<ii", row, len(data)) + data)
    offsets = len(header) + 8 * HEIGHT + np.cumsum([0, *(len(line) for line in lines[:-1])])
    path = tmp_path / "a.exr"
    path.write_bytes(header + offsets.astype("<u8").tobytes() + b"".join(lines))
    try:
        np.testing.assert_allclose(read_panorama(path), 1)
    except UserError as error:
        assert "channels R, G and B; got" in str(error) and "\n" not in str(error)
