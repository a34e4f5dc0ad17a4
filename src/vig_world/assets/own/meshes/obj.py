"""OBJ files: marks, tabs, comments and continued lines, indices from 1 and from the end, concave faces."""

from __future__ import annotations

import re

import numpy as np

from vig_world.assets.own.meshes.polygons import owners, triangles_of

_CONTINUED = re.compile(rb"\\[ \t]*\r?\n")


def plain_obj(data: bytes) -> bytes:
    """The same file with triangles alone, in a form that any reader reads alike.

    Raises:
        ValueError: A face has an index of 0 or beyond the vertices, as in files that count from 0.
    """
    for mark, encoding in ((b"\xff\xfe", "utf-16"), (b"\xfe\xff", "utf-16"), (b"\xef\xbb\xbf", "utf-8-sig")):
        if data.startswith(mark):
            data = data.decode(encoding, "replace").encode()
            break
    data = _CONTINUED.sub(b" ", data)
    if b"\n" not in data:
        data = data.replace(b"\r", b"\n")
    lines: list[bytes] = []
    positions: list[list[bytes]] = []
    counts = {b"v": 0, b"vt": 0, b"vn": 0}
    faces: list[tuple[int, list[bytes]]] = []
    for line in data.splitlines():
        words = line.split(b"#", 1)[0].split()
        if not words:
            continue
        kind = words[0]
        if kind in counts:
            counts[kind] += 1
            if kind == b"v":
                positions.append(words[1:4])
        elif kind == b"f":
            faces.append((len(lines), [_absolute(corner, counts) for corner in words[1:]]))
        # Names of materials may hold a #: only what has numbers is written anew.
        is_geometry = kind in counts or kind in (b"f", b"l", b"p")
        lines.append(b" ".join(words) if is_geometry else line.strip())
    vertices = np.array(positions, np.float64).reshape(-1, 3)
    polygons = [np.array([int(corner.split(b"/")[0]) - 1 for corner in corners]) for _, corners in faces]
    corners = [corner for _, polygon in faces for corner in polygon]
    _, places = triangles_of(vertices, polygons)
    written: dict[int, list[bytes]] = {number: [] for number, _ in faces}
    for place, owner in zip(places, owners(polygons, places), strict=True):
        written[faces[owner][0]].append(b"f " + b" ".join(corners[corner] for corner in place))
    result = [row for number, line in enumerate(lines) for row in written.get(number, [line])]
    return b"\n".join(result) + b"\n"


def _absolute(corner: bytes, counts: dict[bytes, int]) -> bytes:
    """A corner v/vt/vn with its indices counted from 1; ValueError for 0 and for what is not there yet."""
    parts = corner.split(b"/")
    for place, (part, kind) in enumerate(zip(parts, (b"v", b"vt", b"vn"), strict=False)):
        if not part:
            continue
        index = int(part)
        if index < 0:
            index += counts[kind] + 1
            if index < 1:
                raise ValueError(f"a face goes back to {kind.decode()} {int(part)} of {counts[kind]}")
        elif index == 0:
            raise ValueError("a face has the index 0, and OBJ counts from 1; add 1 to all of its indices")
        parts[place] = b"%d" % index
    return b"/".join(parts)
