"""Counts the triangles of a mesh file, from its header or by a pass over its bytes, before it is loaded."""

import struct
from pathlib import Path

from vig.io.checks import name_stand_in, parse_json
from vig.io.errors import UserError
from vig_world.assets.own.meshes.stl import count_stl
from vig_world.assets.own.siblings import MAX_BYTES

MAX_FACES = 1_000_000
MAX_VALUES = 20 * MAX_FACES
_HEADER = 2**16


def refuse_huge(path: Path) -> None:
    """Raise UserError for a mesh file of more than MAX_FACES faces or MAX_BYTES bytes.

    Other errors (ValueError, KeyError, OSError, ...) mean that the file is damaged.
    """
    size = path.stat().st_size
    if size == 0:
        raise UserError(f"{path}: expected a mesh; got an empty file.")
    if size > MAX_BYTES:
        raise UserError(f"{path}: expected at most {MAX_BYTES >> 20} MiB; got {size >> 20}. Simplify it.")
    with path.open("rb") as file:
        if instead := name_stand_in(file.read(1024)):
            raise UserError(f"{path}: expected a mesh; got {instead}.")
    count = {
        ".obj": lambda: _obj(path),
        ".stl": lambda: _stl(path, size),
        ".ply": lambda: _ply(path),
        ".off": lambda: _off(path),
        ".glb": lambda: _gltf(_glb_json(path)),
        ".gltf": lambda: _gltf(path.read_bytes()),
    }[path.suffix.lower()]()
    if count > MAX_FACES:
        raise UserError(f"{path}: expected at most {MAX_FACES:,} faces; got {count:,}. Simplify it.")


def _obj(path: Path) -> int:
    """Return the larger of the triangles that an OBJ file's polygons make and a third of its vertices.

    Stops at the first line at which there are too many: a polygon may have millions of corners.
    """
    triangles, vertices, polygon = 0, 0, False
    with path.open("rb") as file:
        for line in file:
            if not polygon:
                word = line.lower().split(None, 1)[:1]
                polygon = word == [b"f"]
                vertices += word == [b"v"]
                triangles -= 3 * polygon
            if polygon:
                triangles += line.count(b" ") + line.count(b"\t") + line.count(b"\v") + 1
                polygon = line.rstrip(b"\r\n").endswith(b"\\")
            if max(triangles, vertices // 3) > MAX_FACES:
                break
    return max(triangles, vertices // 3)


def _stl(path: Path, size: int) -> int:
    with path.open("rb") as file:
        count = count_stl(file.read(1024), size)
    # at least 80 bytes a triangle of ASCII; files of programs have some 250
    return size // 80 if count is None else count


def _ply(path: Path) -> int:
    """Return the larger of the counts of faces and of a third of the vertices."""
    with path.open("rb") as file:
        header = file.read(_HEADER).split(b"end_header")[0].split()
    counts = [int(header[i + 2]) // share for i, word in enumerate(header) if word == b"element"
              for share in [3 if header[i + 1] == b"vertex" else 1]]  # fmt: skip
    return max(counts, default=0)


def _off(path: Path) -> int:
    with path.open("rb") as file:
        lines = file.read(_HEADER).splitlines()
    words = b" ".join(line.split(b"#")[0] for line in lines).split()
    numbers = [word for word in words[:4] if word.isdigit()]
    return max(int(numbers[1]), int(numbers[0]) // 3)


def _glb_json(path: Path) -> bytes:
    with path.open("rb") as file:
        header = file.read(20)
        if len(header) < 20 or header[:4] != b"glTF":
            raise ValueError("no GLB header")
        (length,) = struct.unpack_from("<I", header, 12)
        return file.read(length)


def _gltf(text: bytes) -> int:
    """Return faces of all nodes' meshes, an instanced mesh counted as often as it is placed."""
    tree = parse_json(text)
    accessors = tree.get("accessors", [])
    total = sum(int(accessor["count"]) for accessor in accessors)
    if total > MAX_VALUES or any(int(accessor["count"]) < 0 for accessor in accessors):
        raise ValueError(
            f"its accessors hold {total} values"
        )  # without a buffer they are zeros, made by a loader

    def faces(primitive: dict) -> int:
        index = primitive.get("indices", primitive["attributes"]["POSITION"])
        return int(accessors[index]["count"]) // 3

    meshes = [sum(faces(part) for part in mesh["primitives"]) for mesh in tree.get("meshes", [])]
    return sum(meshes[node["mesh"]] for node in tree.get("nodes", []) if "mesh" in node)
