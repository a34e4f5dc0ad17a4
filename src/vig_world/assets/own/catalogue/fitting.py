"""A catalogue's model as an OBJ file in metres, upright, of the size that the catalogue states."""

import numpy as np

from vig_world.assets.own.meshes.mtl import library_names, picture_name, plain_lines
from vig_world.assets.own.meshes.obj import plain_obj
from vig_world.assets.own.siblings import readings

_UPRIGHT = np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]], np.float64)
"""Rotation from a catalogue's axes (Y up, front +Z) to those of vig's own furniture (Z up, front -Y)."""


def fit_obj(data: bytes, rotation: np.ndarray, size: np.ndarray) -> bytes:
    """Return an OBJ file turned upright and stretched to a box; materials and their coordinates stay.

    Args:
        data: The OBJ file, in any unit.
        rotation: (3, 3), from the file's axes to the catalogue's: Y up, front +Z.
        size: (3,) metres along X, Y, Z of the catalogue: width, height, depth.

    Returns:
        The file with triangles alone, Z up, front -Y, standing on z = 0 and centred above the origin.

    Raises:
        ValueError: The file is damaged, has no face, or vertices that are not finite.
    """
    lines = plain_obj(data).split(b"\n")
    is_vertex = [line.startswith(b"v ") for line in lines]
    vertices = np.array([line.split()[1:4] for line in lines if line.startswith(b"v ")], np.float64)
    corners = [corner for line in lines if line.startswith(b"f ") for corner in line.split()[1:]]
    used = np.unique(np.array([corner.split(b"/", 1)[0] for corner in corners], np.int64)) - 1
    if not len(used):
        raise ValueError("it has no faces")
    if used.max() >= len(vertices):
        raise ValueError(f"a face has the vertex {used.max() + 1} of {len(vertices)}")
    turned = vertices @ rotation.T
    if not np.isfinite(turned[used]).all():
        raise ValueError("its vertices are not all finite")
    low, high = turned[used].min(0), turned[used].max(0)
    scale = np.where(high > low, size / np.where(high > low, high - low, 1), 1.0)
    foot = np.array([(low + high)[0] / 2, low[1], (low + high)[2] / 2])
    placed = iter(((turned - foot) * scale @ _UPRIGHT.T).tolist())
    written = []
    for line, here in zip(lines, is_vertex, strict=True):
        if here:
            colour = b" ".join(line.split()[4:])
            line = b"v %.8g %.8g %.8g " % tuple(next(placed)) + colour
        elif line.startswith(b"vn "):
            normal = _UPRIGHT @ ((rotation @ np.array(line.split()[1:4], np.float64)) / scale)
            line = b"vn %.5g %.5g %.5g" % tuple(normal / max(float(np.linalg.norm(normal)), 1e-30))
        written.append(line)
    return b"\n".join(written)


def material_files(obj: bytes) -> list[str]:
    """Return the names of the files of materials that an OBJ file may give."""
    return [readings(name)[0] for rest in _rests(obj, (b"mtllib",)) for name in library_names(rest)]


def picture_files(mtl: bytes) -> list[str]:
    """Return the names of the pictures that a file of materials may give."""
    rests = _rests(mtl, (b"map_", b"bump", b"disp", b"refl", b"norm"))
    return [readings(name)[0] for rest in rests for name in picture_name(rest)[0]]


def _rests(data: bytes, keywords: tuple[bytes, ...]) -> list[bytes]:
    lines = [line.strip().split(None, 1) for line in plain_lines(data)]
    return [words[1] for words in lines if len(words) == 2 and words[0].lower().startswith(keywords)]
