"""STL files: binary ones with bytes after their triangles, ASCII ones in any letter case."""

import re
import struct

import numpy as np

_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_NUMBER = rb"([-+]?(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?|[-+]?nan|[-+]?inf)"
_VERTEX = re.compile(rb"\bvertex\s+" + rb"\s+".join([_NUMBER] * 3))


def count_stl(head: bytes, size: int) -> int | None:
    """Return triangles of a binary STL file of `size` bytes by its first 1,024; None for an ASCII one.

    A binary file may begin with "solid", and an ASCII one with a byte order mark or blanks.
    """
    if len(head) < 84:
        return None
    count = int(struct.unpack_from("<I", head, 80)[0])
    if size == 84 + 50 * count:
        return count
    text = head.lower().removeprefix(b"\xef\xbb\xbf").lstrip()
    ascii_words = b"facet" in text or b"vertex" in text or b"\0" not in head
    return None if text.startswith(b"solid") and ascii_words else count


def read_stl(data: bytes) -> tuple[np.ndarray, np.ndarray]:
    """Return vertices (3 F, 3) float64 and faces (F, 3); ValueError for a damaged file."""
    count = count_stl(data[:1024], len(data))
    if count is not None:
        if len(data) < 84 + _FACET.itemsize * count:
            raise ValueError(f"{len(data)} bytes for {count:,} triangles")
        corners = np.frombuffer(data, _FACET, count, 84)["corners"].astype(np.float64).reshape(-1, 3)
    else:
        text = data.lower()
        corners = np.array(_VERTEX.findall(text), np.float64).reshape(-1, 3)
        facets = len(re.findall(rb"\bfacet\s+normal\b", text))
        if len(corners) != 3 * facets or len(re.findall(rb"\bvertex\b", text)) != len(corners):
            raise ValueError(f"{len(corners)} readable vertices of {facets} facets")
    return corners, np.arange(len(corners)).reshape(-1, 3)
