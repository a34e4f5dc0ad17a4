"""PLY files: polygons of any shape, triangle strips, colours of vertices."""

from __future__ import annotations

import io
from dataclasses import dataclass

import numpy as np

from vig_world.assets.own.meshes.polygons import owners, triangles_of

CORNERS = ("vertex_indices", "vertex_index")
COLOURS = ("red", "green", "blue"), ("diffuse_red", "diffuse_green", "diffuse_blue"), ("r", "g", "b")


@dataclass(frozen=True)
class Ply:
    """What a file holds.

    Attributes:
        vertices: (V, 3) float64.
        faces: (F, 3) triangles.
        vertex_colours: (V, 3) uint8, or None.
        face_colours: (F, 3) uint8, or None.
    """

    vertices: np.ndarray
    faces: np.ndarray
    vertex_colours: np.ndarray | None
    face_colours: np.ndarray | None


def read_ply(data: bytes) -> Ply:
    """Read a PLY file; ValueError for a damaged one."""
    from plyfile import PlyData, PlyParseError

    try:
        ply = PlyData.read(io.BytesIO(data.removeprefix(b"\xef\xbb\xbf")))
        elements = {element.name: element.data for element in ply.elements}
        points, polygons, coloured = elements["vertex"], list[np.ndarray](), None
        vertices = np.stack([points[axis] for axis in "xyz"], axis=1).astype(np.float64)
        if "face" in elements and len(rows := _corners(elements["face"])):
            polygons += list(rows)
            coloured = _colours(elements["face"])
        for name in ("tristrips", "tristrip"):
            for row in _corners(elements[name]) if name in elements else ():
                polygons += strip_triangles(np.asarray(row, np.int64))
                coloured = None
    except (PlyParseError, KeyError, IndexError) as error:
        raise ValueError(str(error) or type(error).__name__) from error
    faces, places = triangles_of(vertices, polygons)
    face_colours = None if coloured is None else coloured[owners(polygons, places)]
    return Ply(vertices, faces, _colours(points), face_colours)


def _corners(element: np.ndarray) -> np.ndarray:
    """The lists of corners of an element's rows; none where it has no such property."""
    names = [name for name in CORNERS if name in (element.dtype.names or ())]
    corners: np.ndarray = element[names[0]] if names else np.zeros(0)
    return corners


def strip_triangles(indices: np.ndarray) -> list[np.ndarray]:
    """Triangles of a strip, every other turned over; -1 begins the next strip."""
    triangles: list[np.ndarray] = []
    for strip in np.split(indices, np.flatnonzero(indices < 0)):
        strip = strip[strip >= 0]
        for place in range(len(strip) - 2):
            corners = strip[place : place + 3]
            if len(np.unique(corners)) == 3:
                triangles.append(corners[::-1] if place % 2 else corners)
    return triangles


def _colours(points: np.ndarray) -> np.ndarray | None:
    for names in COLOURS:
        if set(names) <= set(points.dtype.names or ()):
            values = np.stack([points[name] for name in names], axis=1)
            if values.dtype.kind == "f":
                values = 255 * values
            elif values.dtype.itemsize == 2:
                values = values / 257
            return np.clip(np.rint(values), 0, 255).astype(np.uint8)
    return None
