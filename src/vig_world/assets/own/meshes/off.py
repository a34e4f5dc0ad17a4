"""OFF files: polygons of any shape, colours and normals beside the coordinates, comments."""

import re

import numpy as np

from vig_world.assets.own.meshes.polygons import triangulate

_HEADER = re.compile(r"(ST)?(C)?(N)?(4)?(n)?OFF\b", re.ASCII)


def read_off(data: bytes) -> tuple[np.ndarray, np.ndarray]:
    """Return vertices (V, 3) float64 and triangles (F, 3); ValueError for a damaged file or another kind."""
    text = data.removeprefix(b"\xef\xbb\xbf").decode("latin-1")
    lines = [line for line in (row.split("#", 1)[0].strip() for row in text.splitlines()) if line]
    header = _HEADER.match(lines[0]) if lines else None
    if header is not None:
        if header[4] or header[5]:
            raise ValueError("four or more coordinates a vertex, which are not read")
        rest = lines[0][header.end() :].strip()
        if rest.upper().startswith("BINARY"):
            raise ValueError("binary OFF, which is not read; save it as text")
        lines = ([rest] if rest else []) + lines[1:]
    counts = lines[0].split()
    vertex_count, face_count = int(counts[0]), int(counts[1])
    rows = [line.split() for line in lines[1 : 1 + vertex_count + face_count]]
    if len(rows) < vertex_count + face_count or vertex_count < 0 or face_count < 0:
        raise ValueError(f"{len(rows)} lines for {vertex_count} vertices and {face_count} faces")
    # Normals, colours and texture coordinates follow the position in every kind of OFF.
    vertices = np.array([row[:3] for row in rows[:vertex_count]], np.float64).reshape(-1, 3)
    polygons = []
    for row in rows[vertex_count:]:
        size = int(row[0])
        if len(row) < 1 + size:
            raise ValueError(f"a face of {size} corners with {len(row) - 1}")
        polygons.append(np.array(row[1 : 1 + size], np.int64))
    return vertices, triangulate(vertices, polygons)
