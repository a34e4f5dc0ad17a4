"""glTF files: what a reader may drop in silence is decoded, or refused by its name.

The result holds float positions, texture coordinates and colours, and triangles by uint32 indices, as the
specification says to read them: https://registry.khronos.org/glTF/specs/2.0/glTF-2.0.html.
"""

from __future__ import annotations

import base64
import json
import struct
from collections import Counter
from collections.abc import Callable
from typing import Any
from urllib.parse import unquote

import numpy as np

from vig.io.checks import parse_json
from vig_world.assets.own.copies import COPY, cut_at_level, shape_copies

COMPONENTS = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
SIZES = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
POINTS_AND_LINES = (0, 1, 2, 3)
TRIANGLES, STRIP, FAN = 4, 5, 6
DRACO, TRANSFORM = "KHR_draco_mesh_compression", "KHR_texture_transform"
INSTANCING = "EXT_mesh_gpu_instancing"
LEVELS = "MSFT_lod"
HONOURED = {
    LEVELS,
    DRACO,
    TRANSFORM,
    "KHR_mesh_quantization",
    "KHR_materials_unlit",
    "KHR_materials_pbrSpecularGlossiness",
    "EXT_texture_webp",
}
"""Extensions that may be required: they are decoded, or say nothing of shape and colour that is dropped."""
REMEDIES = {
    "EXT_meshopt_compression": "decompress it, for example by gltf-transform copy or gltfpack without -c",
    "KHR_meshopt_compression": "decompress it, for example by gltf-transform copy or gltfpack without -c",
    INSTANCING: "export the instances as meshes of their own",
    "KHR_texture_basisu": "save its textures as PNG or JPEG",
}
WITHIN = 0.01
"""Of a mesh's extent, by which its positions may lie beyond the bounds that its accessors state: of Draco."""


def plain_gltf(data: bytes, read: Callable[[str], bytes], note: Callable[[str], None] | None = None) -> bytes:
    """A GLB file that any reader reads alike, from a `.gltf` or `.glb` file.

    It holds what a viewer shows, the default scene, each node of several levels of detail at the finest.

    Args:
        data: Of the file.
        read: Gives the bytes of another file by the name that this one has for it.
        note: Called with a sentence for each node that is left out as a copy by its name; None: these stay.

    Raises:
        ValueError: It is damaged, its positions lie elsewhere than it states, or it needs what is not read.
    """
    plain = _Plain(*_opened(data), read)
    plain.leave_out_nodes(note)
    return plain.written()


def _opened(data: bytes) -> tuple[dict[str, Any], bytes]:
    """The JSON of a file, and the binary chunk of a GLB."""
    if data[:4] != b"glTF":
        return parse_json(data.removeprefix(b"\xef\xbb\xbf")), b""
    tree, chunk, place = None, b"", 12
    while place + 8 <= len(data):
        length, kind = struct.unpack_from("<I4s", data, place)
        content = data[place + 8 : place + 8 + length]
        if kind == b"JSON" and tree is None:
            tree = parse_json(content)
        elif kind == b"BIN\0":
            chunk = content
        place += 8 + length
    if not isinstance(tree, dict):
        raise ValueError("a GLB without JSON")
    return tree, chunk


class _Plain:
    """One file being made plain: its tree is changed in place, new arrays go behind its buffers."""

    def __init__(self, tree: dict[str, Any], chunk: bytes, read: Callable[[str], bytes]):
        self.tree, self.chunk, self.read = tree, chunk, read
        self.added: list[bytes] = []
        self._check_extensions()
        self.buffers = [self._buffer(buffer) for buffer in tree.get("buffers", [])]

    def leave_out_nodes(self, note: Callable[[str], None] | None) -> None:
        """Take their meshes from nodes that a viewer does not show, and from copies."""
        nodes = self.tree.get("nodes", [])
        coarser = {id for node in nodes for id in node.get("extensions", {}).get(LEVELS, {}).get("ids", [])}
        children = {child for node in nodes for child in node.get("children", [])}
        roots = [number for number in range(len(nodes)) if number not in children]
        if scenes := self.tree.get("scenes"):
            roots = scenes[self.tree.get("scene", 0)].get("nodes", [])
        pending, paths = [(number, "") for number in roots], dict[int, str]()
        while pending:
            number, path = pending.pop()
            if number not in coarser and number not in paths:
                paths[number] = f"{path}/{nodes[number].get('name', number)}".lstrip("/")
                pending += [(child, paths[number]) for child in nodes[number].get("children", [])]
        shown = {number: cut_at_level(path) for number, path in paths.items() if "mesh" in nodes[number]}
        faces = Counter[str]()
        for number, name in shown.items():
            for primitive in self.tree["meshes"][nodes[number]["mesh"]]["primitives"]:
                corners = primitive.get("indices", primitive["attributes"]["POSITION"])
                faces[name] += self.tree["accessors"][corners]["count"]
        names = list(faces)
        pairs = shape_copies(names, list(faces.values())) if note else {}
        copies = {names[copy]: names[original] for copy, original in pairs.items()}
        for number, node in enumerate(nodes):
            if shown and (number not in shown or shown[number] in copies):
                node.pop("mesh", None)
        if note:
            for copy, original in copies.items():
                note(f"left out its node {copy}: {COPY.format(original)}")

    def written(self) -> bytes:
        done: set[int] = set()
        for node in self.tree.get("nodes", []):
            if "mesh" not in node:
                continue
            if "skin" in node:
                raise ValueError("a skinned mesh, which is not read; export it with its pose applied")
            if node.get("weights") and "targets" in self.tree["meshes"][node["mesh"]]["primitives"][0]:
                self.tree["meshes"].append(json.loads(json.dumps(self.tree["meshes"][node["mesh"]])))
                node["mesh"] = len(self.tree["meshes"]) - 1
                self.tree["meshes"][-1]["weights"] = node.pop("weights")
        for number, mesh in enumerate(self.tree.get("meshes", [])):
            if number not in done:
                done.add(number)
                mesh["primitives"] = [
                    self._primitive(primitive, mesh.get("weights", []))
                    for primitive in mesh["primitives"]
                    if primitive.get("mode", TRIANGLES) not in POINTS_AND_LINES
                ]
        self.tree["meshes"] = self.tree.get("meshes", [])
        for mesh in self.tree["meshes"]:
            mesh.pop("weights", None)
        for key in ("extensionsRequired", "animations", "skins"):
            self.tree.pop(key, None)
        return self._packed()

    def _check_extensions(self) -> None:
        required = [name for name in self.tree.get("extensionsRequired", []) if name not in HONOURED]
        instanced = any(INSTANCING in node.get("extensions", {}) for node in self.tree.get("nodes", []))
        for name in [*required, *([INSTANCING] if instanced else [])]:
            raise ValueError(
                f"a file that needs {name}, which is not read; {REMEDIES.get(name, 'export it without')}"
            )

    def _buffer(self, buffer: dict[str, Any]) -> bytes:
        uri = buffer.get("uri")
        if uri is None:
            content = self.chunk
        elif uri.startswith("data:"):
            head, _, body = uri.partition(",")
            content = base64.b64decode(body) if head.endswith(";base64") else unquote(body).encode("latin-1")
        else:
            content = self.read(uri)
        if len(content) < int(buffer["byteLength"]):
            raise ValueError(f"a buffer of {len(content)} bytes where it states {buffer['byteLength']}")
        return content

    def _view(self, number: int) -> tuple[bytes, dict[str, Any]]:
        view = self.tree["bufferViews"][number]
        for name in view.get("extensions", {}):
            if "meshopt" in name:
                raise ValueError(f"a file that needs {name}, which is not read; {REMEDIES.get(name)}")
        start, length = int(view.get("byteOffset", 0)), int(view["byteLength"])
        content = self.buffers[view["buffer"]][start : start + length]
        if start < 0 or len(content) < length:
            raise ValueError("a view beyond its buffer")
        return content, view

    def _raw(self, accessor: dict[str, Any]) -> np.ndarray:
        """The stored numbers (count, size) of an accessor, its sparse ones in their places."""
        count, size = int(accessor["count"]), SIZES[accessor["type"]]
        kind = np.dtype(COMPONENTS[accessor["componentType"]])
        values = np.zeros((count, size), kind)
        if "bufferView" in accessor:
            content, view = self._view(accessor["bufferView"])
            values = _strided(
                content, int(accessor.get("byteOffset", 0)), view.get("byteStride"), kind, count, size
            ).copy()
        if sparse := accessor.get("sparse"):
            places, new = sparse["indices"], sparse["values"]
            where = _strided(
                self._view(places["bufferView"])[0], int(places.get("byteOffset", 0)), None,
                np.dtype(COMPONENTS[places["componentType"]]), int(sparse["count"]), 1,
            )[:, 0].astype(np.int64)  # fmt: skip
            if len(where) and where.max() >= count:
                raise ValueError(f"a sparse accessor of {count} with an index of {where.max()}")
            content = self._view(new["bufferView"])[0]
            values[where] = _strided(
                content, int(new.get("byteOffset", 0)), None, kind, int(sparse["count"]), size
            )
        return values

    def _numbers(self, number: int) -> np.ndarray:
        """An accessor's values (count, size) as floats: whole numbers as fractions where it says so."""
        accessor = self.tree["accessors"][number]
        values = self._raw(accessor)
        if accessor["componentType"] == 5126:
            return values.astype(np.float64)
        if not accessor.get("normalized", False):
            return values.astype(np.float64)
        most = np.iinfo(values.dtype).max
        fractions: np.ndarray = np.maximum(values.astype(np.float64) / most, -1.0)
        return fractions

    def _primitive(self, primitive: dict[str, Any], weights: list[float]) -> dict[str, Any]:
        attributes, mode = dict(primitive["attributes"]), primitive.get("mode", TRIANGLES)
        indices: np.ndarray | None = None
        arrays: dict[str, np.ndarray] = {}
        if compressed := primitive.get("extensions", {}).get(DRACO):
            indices, arrays = self._draco(compressed, attributes)
        for name, number in attributes.items():
            if name in ("POSITION", "COLOR_0") or name.startswith("TEXCOORD_"):
                arrays.setdefault(name, self._numbers(number))
        positions = arrays["POSITION"]
        if indices is None and "indices" in primitive:
            indices = self._raw(self.tree["accessors"][primitive["indices"]])[:, 0].astype(np.int64)
        if indices is None:
            indices = np.arange(len(positions))
        self._check_bounds(self.tree["accessors"][attributes["POSITION"]], positions)
        for weight, target in zip(weights, primitive.get("targets", []), strict=False):
            if weight and "POSITION" in target:
                positions = positions + weight * self._numbers(target["POSITION"])
        arrays["POSITION"] = positions
        self._transform(primitive, arrays)
        faces = _faces(indices, mode)
        if len(faces) and faces.max() >= len(positions):
            raise ValueError(f"a face with corner {faces.max()} of {len(positions)}")
        plain: dict[str, Any] = {
            "mode": TRIANGLES,
            "indices": self._added(faces.reshape(-1, 1), "<u4", "SCALAR"),
        }
        if "material" in primitive:
            plain["material"] = primitive["material"]
        kinds = {2: "VEC2", 3: "VEC3", 4: "VEC4"}
        plain["attributes"] = {
            name: self._added(values, "<f4", kinds[values.shape[1]]) for name, values in arrays.items()
        }
        return plain

    def _check_bounds(self, accessor: dict[str, Any], positions: np.ndarray) -> None:
        """ValueError where positions lie elsewhere than the file states: they were not read as they are."""
        if not len(positions) or "min" not in accessor or "max" not in accessor:
            return
        low, high = np.array(accessor["min"], float), np.array(accessor["max"], float)
        if accessor.get("normalized"):  # the bounds are those of the stored numbers
            most = np.iinfo(COMPONENTS[accessor["componentType"]]).max
            low, high = np.maximum(low / most, -1), np.maximum(high / most, -1)
        allowed = WITHIN * max(float(np.ptp(positions, axis=0).max()), float((high - low).max()), 1e-30)
        off = max(np.abs(positions.min(0) - low).max(), np.abs(positions.max(0) - high).max())
        if not off <= allowed:
            raise ValueError(
                f"positions from {positions.min(0).round(4).tolist()} to {positions.max(0).round(4).tolist()}"
                f" where it states {low.round(4).tolist()} to {high.round(4).tolist()}"
            )

    def _draco(
        self, compressed: dict[str, Any], attributes: dict[str, int]
    ) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        """Triangle corners and arrays of a Draco-compressed primitive."""
        try:
            import DracoPy
        except ImportError:
            raise ValueError("a Draco-compressed mesh; decompress it, or pip install 'vig[draco]'") from None
        mesh = DracoPy.decode(self._view(compressed["bufferView"])[0])
        arrays: dict[str, np.ndarray] = {}
        for name, number in compressed["attributes"].items():
            if name not in attributes or not (
                name in ("POSITION", "COLOR_0") or name.startswith("TEXCOORD_")
            ):
                continue
            values = np.asarray(mesh.get_attribute_by_unique_id(number)["data"])
            accessor = self.tree["accessors"][attributes[name]]
            if accessor.get("normalized") and values.dtype.kind in "iu":
                values = np.maximum(values / np.iinfo(COMPONENTS[accessor["componentType"]]).max, -1.0)
            arrays[name] = values.astype(np.float64)
        return np.asarray(mesh.faces, np.int64).ravel(), arrays

    def _transform(self, primitive: dict[str, Any], arrays: dict[str, np.ndarray]) -> None:
        """Apply KHR_texture_transform of the material's colour to its texture coordinates."""
        if "material" not in primitive:
            return
        surface = self.tree["materials"][primitive["material"]].get("pbrMetallicRoughness", {})
        texture = surface.get("baseColorTexture", {})
        place = texture.get("texCoord", 0)
        change = texture.get("extensions", {}).get(TRANSFORM)
        if change is not None:
            place = change.get("texCoord", place)
        coordinates = arrays.get(f"TEXCOORD_{place}")
        if coordinates is None:
            return
        if change is not None:
            turn = float(change.get("rotation", 0.0))
            u, v = (coordinates * np.array(change.get("scale", [1.0, 1.0]), float)).T
            cos, sin = np.cos(turn), np.sin(turn)
            offset = np.array(change.get("offset", [0.0, 0.0]), float)
            coordinates = np.stack([cos * u + sin * v, -sin * u + cos * v], axis=1) + offset
        for name in [name for name in arrays if name.startswith("TEXCOORD_")]:
            del arrays[name]
        arrays["TEXCOORD_0"] = coordinates  # the one that the colour is by

    def _added(self, values: np.ndarray, kind: str, form: str) -> int:
        """The number of a new accessor of an array (count, size)."""
        content = np.ascontiguousarray(values, kind).tobytes()
        views, accessors = self.tree.setdefault("bufferViews", []), self.tree.setdefault("accessors", [])
        views.append({"buffer": -1, "byteOffset": sum(map(len, self.added)), "byteLength": len(content)})
        self.added.append(content + b"\0" * (-len(content) % 4))
        accessor = {
            "bufferView": len(views) - 1,
            "componentType": 5125 if kind == "<u4" else 5126,
            "count": len(values),
            "type": form,
        }
        accessors.append(accessor)
        return len(accessors) - 1

    def _packed(self) -> bytes:
        starts, whole = [], b""
        for buffer in [*self.buffers, b"".join(self.added)]:
            starts.append(len(whole))
            whole += buffer + b"\0" * (-len(buffer) % 4)
        for view in self.tree.get("bufferViews", []):
            view["byteOffset"] = int(view.get("byteOffset", 0)) + starts[view["buffer"]]
            view["buffer"] = 0
        for material in self.tree.get("materials", []):
            texture = material.get("pbrMetallicRoughness", {}).get("baseColorTexture", {})
            texture.pop("texCoord", None)
            texture.pop("extensions", None)
        self.tree["buffers"] = [{"byteLength": len(whole)}]
        text = json.dumps(self.tree).encode()
        text += b" " * (-len(text) % 4)
        chunks = (text, b"JSON"), (whole, b"BIN\0")
        body = b"".join(struct.pack("<I4s", len(each), kind) + each for each, kind in chunks)
        return struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body


def _strided(
    content: bytes, start: int, stride: int | None, kind: np.dtype, count: int, size: int
) -> np.ndarray:
    """Numbers (count, size) of a view, its rows `stride` bytes apart or one behind the other."""
    stride = stride or kind.itemsize * size
    last = start + stride * (count - 1) + kind.itemsize * size
    if count < 0 or start < 0 or (count and last > len(content)):
        raise ValueError(f"an accessor of {count} values beyond its view")
    strides = stride, kind.itemsize
    return np.ndarray((count, size), kind, content, start, strides) if count else np.zeros((0, size), kind)


def _faces(indices: np.ndarray, mode: int) -> np.ndarray:
    """Triangles (F, 3) of a primitive's indices."""
    if mode == TRIANGLES:
        return indices[: len(indices) // 3 * 3].reshape(-1, 3)
    count = max(len(indices) - 2, 0)
    place = np.arange(count)
    if mode == FAN:
        corners = np.stack([np.zeros(count, np.int64), place + 1, place + 2], axis=1)
    elif mode == STRIP:
        odd = place % 2
        corners = np.stack([place, place + 1 + odd, place + 2 - odd], axis=1)
    else:
        raise ValueError(f"primitives of mode {mode}")
    return indices[corners]
