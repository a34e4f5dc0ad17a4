"""OBJ files: marks, tabs, comments and continued lines, indices from 1 and from the end, concave faces.

Their materials are read by `mtl`.
"""

import numpy as np

from vig_world.assets.own.meshes.mtl import plain_lines, read_materials
from vig_world.assets.own.meshes.polygons import owners, triangles_of
from vig_world.assets.own.siblings import Siblings, shown
from vig_world.assets.own.surfaces import Surface, SurfaceMesh, colour_faces, colour_vertices


def read_obj(data: bytes, siblings: Siblings) -> list[SurfaceMesh]:
    """Read an OBJ file, a mesh for each material. Colours of vertices count where that has no picture.

    Raises:
        ValueError: It is damaged.
    """
    rows: dict[bytes, list[list[bytes]]] = {b"v": [], b"vt": []}
    groups: dict[bytes, list[bytes]] = {}
    libraries, material = [], b""
    for line in plain_obj(data).split(b"\n"):
        keyword, *rest = line.split(None, 1)[:2] or [b""]
        if keyword in rows:
            rows[keyword].append(rest[0].split())
        elif keyword == b"f":
            groups.setdefault(material, []).extend(rest[0].split())
        elif rest and keyword.lower() == b"usemtl":
            material = rest[0]
        elif rest and keyword.lower() == b"mtllib":
            libraries.append(rest[0])
    points = np.array([row[:3] for row in rows[b"v"]], np.float64)
    coordinates = np.array([[*row, b"0"][:2] for row in rows[b"vt"]], np.float64).reshape(-1, 2)
    colours = None
    if rows[b"v"] and all(len(row) >= 6 for row in rows[b"v"]):
        colours = colour_vertices(np.array([row[3:6] for row in rows[b"v"]], np.float64))
        colours = colours if np.ptp(colours, axis=0).any() else None
        siblings.instead = "grey" if colours is None else "the colours of its vertices"
    meshes = []
    surfaces = read_materials(list(groups), libraries, siblings)
    for (name, corners), surface in zip(groups.items(), surfaces, strict=True):
        number: dict[bytes, int] = {}
        faces = np.array([number.setdefault(corner, len(number)) for corner in corners]).reshape(-1, 3)
        indices = np.array([[int(part or 0) for part in (*c.split(b"/"), b"")[:2]] for c in number]) - 1
        has_uv = len(coordinates) and (0 <= indices[:, 1]).any() and indices[:, 1].max() < len(coordinates)
        uv = np.where(indices[:, 1:] >= 0, coordinates[indices[:, 1]], 0.0) if has_uv else None
        tints = None
        if colours is not None and (surface is None or surface.picture is None):
            surface = Surface(np.ones(3), None, 1.0 if surface is None else surface.opacity)
            tints = colour_faces(colours[indices[:, 0]], faces)
        meshes.append(SurfaceMesh(points[indices[:, 0]], faces, uv, surface, tints, names=(shown(name),)))
    return meshes


def plain_obj(data: bytes) -> bytes:
    """Return the same file with triangles alone, in a form that any reader reads alike.

    Raises:
        ValueError: A face has an index of 0 or beyond the vertices, as in files that count from 0.
    """
    lines: list[bytes] = []
    positions: list[list[bytes]] = []
    counts = {b"v": 0, b"vt": 0, b"vn": 0}
    faces: list[tuple[int, list[bytes]]] = []
    for line in plain_lines(data):
        words = line.split(b"#", 1)[0].split()
        if not words:
            continue
        kind = words[0] = words[0].lower()
        if kind in counts:
            counts[kind] += 1
            if kind == b"v":
                positions.append(words[1:4])
        elif kind == b"f":
            faces.append((len(lines), [_absolute(corner, counts) for corner in words[1:]]))
        # Names of materials may hold a #: only lines of numbers are written anew.
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
    """Return a corner v/vt/vn with its indices counted from 1; ValueError for 0 and one not defined yet."""
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
