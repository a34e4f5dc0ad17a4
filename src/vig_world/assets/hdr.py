"""HDR panorama files."""

from pathlib import Path
from typing import Any

import numpy as np

from vig.io.errors import UserError
from vig.photo.checks import check_size, existing_file, head_of, refuse
from vig.photo.colour import REC709, rec709_from
from vig.photo.formats import EXR_MAGIC, HDR_MAGIC
from vig_world.extras import optional_import

UNDERSHOOT = 0.05


def read_panorama(path: str | Path) -> np.ndarray:
    """Read an equirectangular `.hdr` or `.exr` panorama as linear RGB radiance, (H, 2 H, 3) float32 >= 0.

    Row 0 is straight up whatever the order of a Radiance file's scanlines; EXPOSURE and COLORCORR are undone.
    An OpenEXR file's display window counts, black where it holds no data; of several parts the
    largest with RGB. Other primaries become Rec. 709's, colours outside those clipped. Values below 0 by at
    most `UNDERSHOOT` of the mean become 0: resampling filters leave such values.

    Raises:
        UserError: For a missing, unreadable or damaged file, one that is not twice as wide as high, tiny or
            huge, one that holds NaN, infinite or more negative values, one that is black throughout, and
            one without RGB radiance: XYZE, cube maps, deep pixels, integers, luminance and chroma.
    """
    path = existing_file(path)
    head = head_of(path)
    if not head.startswith(HDR_MAGIC):
        refuse(path, "an HDR panorama (.hdr or .exr)", "something else", "Convert it to .hdr or .exr.")
    try:
        rgb, chromaticities = _exr(path) if head.startswith(EXR_MAGIC) else _radiance(path)
    except UserError:
        raise
    except Exception as error:  # OpenImageIO may raise anything on a damaged file, even while reporting it
        if "subsampled" in str(error).lower():
            refuse(path, "channels R, G and B", "luminance and chroma", "Export it as RGB.")
        refuse(path, "a whole HDR panorama", f"a damaged one ({error})", "Copy it again.")
    finite = np.isfinite(rgb)
    lowest = -UNDERSHOOT * float(rgb[finite].mean(dtype=np.float64)) if finite.any() else 0.0
    bad = np.count_nonzero(~(finite & (rgb >= min(lowest, 0.0))).all(-1))
    if bad:
        fault = f"{bad} pixels with NaN, infinite or negative values"
        refuse(path, "finite radiance of at least 0", fault, "Clean the panorama.")
    if not (rgb > 0).any():
        refuse(path, "a panorama with some light in it", "a black one", "Choose another.")
    try:
        matrix = rec709_from(chromaticities)
    except ValueError:
        stated = " ".join(f"{value:g}" for value in chromaticities)
        refuse(path, "chromaticities of a colour space", stated, "Correct or remove them.")
    if np.abs(matrix - np.eye(3)).max() > 1e-3:
        rgb = rgb @ matrix.T.astype(np.float32)
    return np.maximum(rgb, 0)


def _radiance(path: Path) -> tuple[np.ndarray, tuple[float, ...]]:
    """Decode a Radiance file: (H, 2 H, 3) float32, not checked, and its chromaticities."""
    with path.open("rb") as file:
        lines = file.read(1 << 16).split(b"\n\n", 1)
    header = lines[0].decode("latin-1").splitlines()
    order = lines[1].split(b"\n", 1)[0].decode("latin-1").split()[::2] if len(lines) > 1 else []
    fields = [line.split("=", 1) for line in header if "=" in line and not line.startswith((" ", "\t", "#"))]
    stated = {key.strip().upper(): value.strip() for key, value in fields}
    if "xyze" in stated.get("FORMAT", "").lower():
        refuse(path, "RGB radiance", "XYZE", "Convert it with ra_xyze -r.")
    if float(stated.get("GAMMA", 1)) != 1:
        refuse(path, "linear radiance", f"GAMMA={stated['GAMMA']}", "Save it without gamma.")
    pixels = _pixels(path, _open_image(path))
    if "X" in order[0].upper():
        pixels, order = pixels.transpose(1, 0, 2), order[::-1]
    if order[0][0] == "+":
        pixels = pixels[::-1]
    if order[1][0] == "-":
        pixels = pixels[:, ::-1]
    _check_shape(path, pixels.shape[1], pixels.shape[0])
    for key, value in fields:
        if key.strip().upper() in ("EXPOSURE", "COLORCORR"):
            factor = np.array(value.split(), np.float32)
            pixels = pixels / (factor if (factor > 0).all() else 1)
    primaries = tuple(float(value) for value in stated.get("PRIMARIES", "").split())
    return np.ascontiguousarray(pixels), primaries or REC709


def _exr(path: Path) -> tuple[np.ndarray, tuple[float, ...]]:
    """Decode an OpenEXR file: the display window (H, 2 H, 3) float32, not checked, and its chromaticities."""
    source = _open_image(path)
    parts: list[tuple[int, Any, list[int]]] = []
    names: list[str] = []
    number = 0
    while source.seek_subimage(number, 0):
        spec = source.spec()
        names += spec.channelnames
        if channels := _rgb_channels(path, spec.channelnames):
            parts.append((number, spec, channels))
        number += 1
    if not parts:
        refuse(path, "channels R, G and B", ", ".join(names), "Export it as RGB.")
    number, spec, channels = max(parts, key=lambda part: part[1].width * part[1].height)
    kinds = {str(spec.channelformat(channel)) for channel in channels}
    if spec.deep or not kinds <= {"half", "float"}:
        contents = "deep pixels" if spec.deep else "integers"
        refuse(path, "half or float pixels", contents, "Export it as flat half or float.")
    if spec.get_string_attribute("textureformat") == "CubeFace Environment":
        refuse(path, "an equirectangular panorama", "a cube map", "Convert it.")
    chromaticities = spec.getattribute("chromaticities")
    space = spec.get_string_attribute("colorInteropID")
    if not chromaticities and space and not space.startswith("lin_rec709"):
        refuse(path, "linear Rec. 709 or chromaticities", space, "Convert it to linear Rec. 709.")
    _check_shape(path, spec.full_width, spec.full_height)
    check_size(path, spec.width, spec.height)
    source.seek_subimage(number, 0)
    pixels = _pixels(path, source)[..., channels]
    display = np.zeros((spec.full_height, spec.full_width, 3), np.float32)
    x, y = spec.x - spec.full_x, spec.y - spec.full_y
    left, right = max(x, 0), min(x + spec.width, spec.full_width)
    top, bottom = max(y, 0), min(y + spec.height, spec.full_height)
    if left < right and top < bottom:
        display[top:bottom, left:right] = pixels[top - y : bottom - y, left - x : right - x]
    return display, tuple(chromaticities or REC709)


def _rgb_channels(path: Path, names: list[str]) -> list[int]:
    """Return the places of R, G and B among a part's channel names, or of its one layer that has them."""
    layers: dict[str, dict[str, int]] = {}
    for index, name in enumerate(names):
        layer, _, channel = name.upper().rpartition(".")
        layers.setdefault(layer, {})[channel] = index
    coloured = {layer: places for layer, places in layers.items() if {"R", "G", "B"} <= places.keys()}
    if len(coloured) > 1 and "" not in coloured:
        refuse(path, "one layer of R, G and B", ", ".join(coloured), "Export the one that is meant.")
    places = coloured.get("") or next(iter(coloured.values()), {})
    return [places[channel] for channel in "RGB"] if places else []


def _check_shape(path: Path, width: int, height: int) -> None:
    check_size(path, width, height)
    if width != 2 * height:
        size = f"{width} x {height} pixels"
        refuse(path, "an equirectangular panorama, twice as wide as high", size, "Crop or resize it.")


def _open_image(path: Path) -> Any:
    with optional_import("world"):  # 80 ms that only panoramas need to spend
        import OpenImageIO as oiio

    source = oiio.ImageInput.open(str(path))
    if source is None:
        raise OSError(oiio.geterror())
    return source


def _pixels(path: Path, source: Any) -> np.ndarray:
    spec = source.spec()
    check_size(path, spec.width, spec.height)
    pixels = source.read_image("float")
    if pixels is None:
        raise OSError(source.geterror())
    return np.asarray(pixels, np.float32)
