"""Picture files of every kind for the tests of reading, written byte by byte where no library writes them."""

import struct
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from vig.io.errors import UserError
from vig.photo.images import read_photo

SIZE = (24, 20)  # width, height


def flat(*channels: float, dtype: type = np.uint8) -> np.ndarray:
    """A picture (20, 24, C) of one colour."""
    return np.full((SIZE[1], SIZE[0], len(channels)), channels, dtype)


def refused(path: Path, match: str, read: Callable[[Path], object] = read_photo) -> None:
    """Reading raises one line for the user."""
    with pytest.raises(UserError, match=match) as caught:
        read(path)
    assert "\n" not in str(caught.value)


def is_light(
    photo: np.ndarray, light: float | tuple[float, ...] | np.ndarray, tolerance: float = 2e-3
) -> None:
    """A photo (H, W, 3) of linear light."""
    assert photo.dtype == np.float32 and photo.shape[2] == 3
    np.testing.assert_allclose(photo, np.broadcast_to(light, photo.shape), atol=tolerance)


def chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def png(path: Path, pixels: np.ndarray, colour_type: int, *chunks: tuple[bytes, bytes]) -> Path:
    """Write pixels (H, W, C) uint8 or uint16 as a PNG with further chunks."""
    height, width = pixels.shape[:2]
    bits = 8 * pixels.itemsize
    rows = b"".join(b"\0" + row.astype(f">u{pixels.itemsize}").tobytes() for row in pixels)
    header = struct.pack(">IIBBBBB", width, height, bits, colour_type, 0, 0, 0)
    body = chunk(b"IHDR", header) + b"".join(chunk(*extra) for extra in chunks)
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + body + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b""))
    return path


def gama(exponent: float) -> tuple[bytes, bytes]:
    return b"gAMA", struct.pack(">I", round(exponent * 100_000))


def chrm(*white_then_rgb: float) -> tuple[bytes, bytes]:
    return b"cHRM", struct.pack(">8I", *(round(value * 100_000) for value in white_then_rgb))


def cicp(primaries: int, transfer: int, full: bool = True) -> tuple[bytes, bytes]:
    return b"cICP", bytes([primaries, transfer, 0, full])


def profile(space: bytes, gamma: float, description: bytes = b"test", cicp: bytes = b"") -> bytes:
    """An ICC profile, version 2, of sRGB's primaries and a pure power: `space` is b"RGB " or b"GRAY"."""

    def xyz(*values: float) -> bytes:
        return b"XYZ \0\0\0\0" + struct.pack(">3i", *(round(value * 65536) for value in values))

    curve = b"curv\0\0\0\0" + struct.pack(">IH", 1, round(gamma * 256)) + b"\0\0"
    text = b"desc\0\0\0\0" + struct.pack(">I", len(description) + 1) + description + bytes(79)
    tags = {b"desc": text + bytes(-len(text) % 4), b"wtpt": xyz(0.9642, 1, 0.8249)}
    tags[b"cprt"] = b"text\0\0\0\0x\0\0\0"
    if space == b"GRAY":
        tags[b"kTRC"] = curve
    else:
        columns = ((0.4360, 0.2225, 0.0139), (0.3851, 0.7169, 0.0971), (0.1431, 0.0606, 0.7141))
        for name, column in zip((b"r", b"g", b"b"), columns, strict=True):
            tags |= {name + b"XYZ": xyz(*column), name + b"TRC": curve}
    if cicp:
        tags[b"cicp"] = b"cicp\0\0\0\0" + cicp
    offset, table, body = 132 + 12 * len(tags), struct.pack(">I", len(tags)), b""
    for name, data in tags.items():
        table += name + struct.pack(">II", offset + len(body), len(data))
        body += data
    head = struct.pack(">I4sI4s4s4s", offset + len(body), b"lcms", 0x02100000, b"mntr", space, b"XYZ ")
    head += struct.pack(">6H", 2026, 1, 1, 0, 0, 0) + b"acsp" + bytes(28)
    head += struct.pack(">3i", 63190, 65536, 54061)
    return head + bytes(128 - len(head)) + table + body


def tiff(
    path: Path, *pages: tuple[np.ndarray | bytes, dict[int, int | tuple[int, ...]]], order: str = "<"
) -> Path:
    """Write an uncompressed TIFF: of each page samples (H, W, C), or bytes, and tags beyond the usual."""
    data = (b"II*\0" if order == "<" else b"MM\0*") + struct.pack(order + "I", 8)
    for number, (pixels, extra) in enumerate(pages):
        height, width, channels = pixels.shape if isinstance(pixels, np.ndarray) else (*SIZE[::-1], 1)
        body = (
            pixels if isinstance(pixels, bytes) else pixels.astype(pixels.dtype.newbyteorder(order)).tobytes()
        )
        bits = 8 * pixels.itemsize if isinstance(pixels, np.ndarray) else 0
        tags = {256: width, 257: height, 258: (bits,) * channels, 259: 1, 262: 2 if channels > 2 else 1}
        tags |= {273: 0, 277: channels, 278: height, 279: len(body), **extra}
        count = len(tags)
        place = len(data) + 2 + 12 * count + 4  # of what does not fit into an entry
        longer, entries = b"", b""
        for tag, value in sorted(tags.items()):
            values = value if isinstance(value, tuple) else (value,)
            letter, kind = ("B", 7) if tag == 34675 else ("I", 4) if tag in (273, 279, 330) else ("H", 3)
            packed = struct.pack(f"{order}{len(values)}{letter}", *values)
            if len(packed) > 4:
                held = packed.ljust(len(packed) + len(packed) % 2, b"\0")
                packed, longer = struct.pack(order + "I", place + len(longer)), longer + held
            entries += struct.pack(order + "HHI", tag, kind, len(values)) + packed.ljust(4, b"\0")
            if tag == 273:
                strip = len(entries) - 4
        entries = entries[:strip] + struct.pack(order + "I", place + len(longer)) + entries[strip + 4 :]
        after = place + len(longer) + len(body)
        after += after % 2
        following = after if number + 1 < len(pages) else 0
        data += struct.pack(order + "H", count) + entries + struct.pack(order + "I", following)
        data = (data + longer + body).ljust(after, b"\0")
    path.write_bytes(data)
    return path
