"""PLY files: polygons of any shape, triangle strips, colours of vertices, pictures."""

import io
import re

import numpy as np

from vig_world.assets.own.meshes.polygons import owners, triangles_of
from vig_world.assets.own.siblings import Siblings, shown
from vig_world.assets.own.surfaces import Surface, SurfaceMesh, colour_faces, colour_vertices, linear_picture

CORNERS = ("vertex_indices", "vertex_index")
COLOURS = ("red", "green", "blue"), ("diffuse_red", "diffuse_green", "diffuse_blue"), ("r", "g", "b")
_REMARK = re.compile(rb"(?<=[\r\n])(?:comment|obj_info)\b([^\r\n]*)(?:\r\n|\n|\r)")


def read_ply(data: bytes, siblings: Siblings) -> list[SurfaceMesh]:
    """Read a PLY file, a mesh for each of its pictures; colours count where those cannot be read.

    Pictures are named by comments (TextureFile) and placed by coordinates of vertices or of faces' corners.

    Raises:
        ValueError: It is damaged.
    """
    from plyfile import PlyData, PlyParseError

    head, end, body = data.removeprefix(b"\xef\xbb\xbf").partition(b"end_header")
    remarks = [remark.split(None, 1) for remark in _REMARK.findall(head)]
    pictures = [words[1].strip(b" \t\"'") for words in remarks
                if len(words) == 2 and words[0].lower().rstrip(b":") == b"texturefile"]  # fmt: skip
    wedges, numbers, coloured = None, None, None
    try:
        ply = PlyData.read(io.BytesIO(_REMARK.sub(b"", head) + end + body))  # its remarks may be no ASCII
        elements = {element.name: element.data for element in ply.elements}
        points, polygons = elements["vertex"], list[np.ndarray]()
        vertices = np.stack([points[axis] for axis in "xyz"], axis=1).astype(np.float64)
        if "face" in elements and len(rows := _corners(elements["face"])):
            polygons += list(rows)
            coloured = _colours(elements["face"])
            wedges, numbers = (_values(elements["face"], name) for name in ("texcoord", "texnumber"))
        for name in ("tristrips", "tristrip"):
            for row in _corners(elements[name]) if name in elements else ():
                polygons += strip_triangles(np.asarray(row, np.int64))
                coloured = wedges = numbers = None
    except (PlyParseError, KeyError, IndexError) as error:
        raise ValueError(str(error) or type(error).__name__) from error
    faces, places = triangles_of(vertices, polygons)
    owner = owners(polygons, places)
    colours = None if coloured is None else coloured[owner]
    if colours is None and (of_vertices := _colours(points)) is not None:
        colours = colour_faces(of_vertices, faces)
    coordinates = ("texture_u", "texture_v"), ("s", "t"), ("u", "v"), ("texture_s", "texture_t")
    uv = next((np.stack([points[u], points[v]], axis=1) for u, v in coordinates
               if {u, v} <= set(points.dtype.names or ())), None)  # fmt: skip
    if wedges is not None:
        # A face without a picture may have no coordinates.
        corners = [wedge if len(wedge) else np.zeros(2 * len(polygon))
                   for wedge, polygon in zip(wedges, polygons, strict=True)]  # fmt: skip
        if all(len(wedge) == 2 * len(polygon) for wedge, polygon in zip(corners, polygons, strict=True)):
            uv = np.concatenate([np.zeros(0), *corners]).reshape(-1, 2)[places.ravel()]
            vertices, faces = vertices[faces.ravel()], np.arange(faces.size).reshape(-1, 3)
    siblings.instead = "grey" if colours is None else "the colours of its vertices or faces"
    if uv is None or not pictures:
        if pictures:
            siblings.note(f"{shown(pictures[0])} without texture coordinates")
        elif uv is not None and colours is None:
            siblings.note("texture coordinates without a picture (TextureFile)")
        return [SurfaceMesh(vertices, faces, colours=colours)]
    meshes = []
    number = np.zeros(len(faces), np.int64) if numbers is None else numbers[owner].astype(np.int64)
    for picture in np.unique(number):
        chosen = number == picture
        image = siblings.image(pictures[picture]) if 0 <= picture < len(pictures) else None
        surface = None if image is None else Surface(np.ones(3), linear_picture(image))
        tints = None if surface or colours is None else colours[chosen]
        meshes.append(SurfaceMesh(vertices, faces[chosen], uv, surface, tints))
    return meshes


def _values(element: np.ndarray, name: str) -> np.ndarray | None:
    return element[name] if name in (element.dtype.names or ()) else None


def _corners(element: np.ndarray) -> np.ndarray:
    """Return the lists of corners of an element's rows; none where it has no such property."""
    names = [name for name in CORNERS if name in (element.dtype.names or ())]
    return element[names[0]] if names else np.zeros(0)


def strip_triangles(indices: np.ndarray) -> list[np.ndarray]:
    """Return triangles of a strip, every other turned over; -1 begins the next strip."""
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
            return colour_vertices(np.stack([points[name] for name in names], axis=1))
    return None
