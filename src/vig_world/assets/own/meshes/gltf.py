"""glTF files: features that a reader may drop silently are decoded, or refused by name.

They are read as the specification says: https://registry.khronos.org/glTF/specs/2.0/glTF-2.0.html.
"""

import base64
import struct
from collections import Counter
from dataclasses import replace
from typing import Any
from urllib.parse import unquote

import numpy as np
from scipy.spatial.transform import Rotation

from vig.io.checks import parse_json
from vig_world.assets.own.copies import COPY, cut_at_level, shape_copies
from vig_world.assets.own.siblings import Siblings
from vig_world.assets.own.surfaces import GREY, Surface, SurfaceMesh, linear_picture

COMPONENTS = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
SIZES = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
TRIANGLES, STRIP, FAN = 4, 5, 6
DRACO, TRANSFORM = "KHR_draco_mesh_compression", "KHR_texture_transform"
GLOSSINESS, WEBP = "KHR_materials_pbrSpecularGlossiness", "EXT_texture_webp"
INSTANCING = "EXT_mesh_gpu_instancing"
LEVELS = "MSFT_lod"
HONOURED = {LEVELS, DRACO, TRANSFORM, "KHR_mesh_quantization", "KHR_materials_unlit", GLOSSINESS, WEBP}
"""Extensions that may be required: they are decoded, or do not affect shape and colour."""
REMEDIES = {
    "EXT_meshopt_compression": "decompress it, for example by gltf-transform copy or gltfpack without -c",
    "KHR_meshopt_compression": "decompress it, for example by gltf-transform copy or gltfpack without -c",
    INSTANCING: "export the instances as meshes of their own",
    "KHR_texture_basisu": "save its textures as PNG or JPEG",
}
WITHIN = 0.01  # share of its extent by which a mesh of Draco may exceed the bounds that its accessors state


def read_gltf(data: bytes, siblings: Siblings, leave_out_copies: bool = True) -> list[SurfaceMesh]:
    """Read the meshes of a `.gltf` or `.glb` file that viewers show: one a primitive, by nodes' names.

    This is the default scene, each node of several levels of detail at the finest.

    Args:
        data: Content of the file.
        siblings: Reads the other files that it names.
        leave_out_copies: Whether nodes that are called a level of detail or a collision hull are left out.

    Raises:
        ValueError: It is damaged, has positions outside its stated bounds, or needs unsupported features.
    """
    meshes = _Reader(*_open(data), siblings).meshes()
    return _without_copies(meshes, siblings) if leave_out_copies else meshes


def _without_copies(meshes: list[SurfaceMesh], siblings: Siblings) -> list[SurfaceMesh]:
    """Leave out nodes that repeat another by their names, with a note on each."""
    paths = [cut_at_level("/".join(mesh.names)) for mesh in meshes]
    faces = Counter[str]()
    for path, mesh in zip(paths, meshes, strict=True):
        faces[path] += len(mesh.faces)
    names = list(faces)
    pairs = shape_copies(names, list(faces.values()))
    copies = {names[copy]: names[original] for copy, original in pairs.items()}
    siblings.notes += [f"left out its node {copy}: {COPY.format(of)}" for copy, of in copies.items()]
    return [mesh for path, mesh in zip(paths, meshes, strict=True) if path not in copies]


def _open(data: bytes) -> tuple[dict[str, Any], bytes]:
    """Return the JSON of a file, and the binary chunk of a GLB."""
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


class _Reader:
    """Reader of one file."""

    def __init__(self, tree: dict[str, Any], chunk: bytes, siblings: Siblings):
        self.tree, self.chunk, self.siblings = tree, chunk, siblings
        self._check_extensions()
        self.buffers = [self._buffer(buffer) for buffer in tree.get("buffers", [])]
        for material in tree.get("materials", []):
            _use_diffuse(material)
        self.surfaces: dict[int, Surface] = {}

    def meshes(self) -> list[SurfaceMesh]:
        nodes, scenes = self.tree.get("nodes", []), self.tree.get("scenes")
        children = {child for node in nodes for child in node.get("children", [])}
        roots = (
            scenes[self.tree.get("scene", 0)].get("nodes", [])
            if scenes
            else set(range(len(nodes))) - children
        )
        coarser = {id for node in nodes for id in node.get("extensions", {}).get(LEVELS, {}).get("ids", [])}
        primitives: dict[tuple[int, ...], list[SurfaceMesh]] = {}
        meshes: list[SurfaceMesh] = []
        pending = [(root, np.eye(4), tuple[str, ...]()) for root in roots]
        seen: set[int] = set(coarser)
        most_nested = 500  # nodes, one within the other
        while pending:
            number, frame, names = pending.pop()
            if number in seen:  # a node has one parent, and is not its own ancestor
                continue
            if len(names) > most_nested:
                raise ValueError(f"nodes nested more than {most_nested} deep")
            seen.add(number)
            node = nodes[number]
            frame, names = frame @ _matrix(node), (*names, str(node.get("name", number)))
            pending += [(child, frame, names) for child in node.get("children", [])]
            if "mesh" not in node:
                continue
            if "skin" in node:
                raise ValueError("a skinned mesh, which is not read; export it with its pose applied")
            mesh = self.tree["meshes"][node["mesh"]]
            weights = node.get("weights") or mesh.get("weights", [])
            key = (node["mesh"], *weights)
            if key not in primitives:
                primitives[key] = [
                    self._primitive(primitive, weights)
                    for primitive in mesh["primitives"]
                    if primitive.get("mode", TRIANGLES) not in (0, 1, 2, 3)
                ]
            meshes += [_place(part, frame, names) for part in primitives[key]]
        return sorted(meshes, key=lambda mesh: mesh.names[-1])

    def _check_extensions(self) -> None:
        required = [name for name in self.tree.get("extensionsRequired", []) if name not in HONOURED]
        instanced = any(INSTANCING in node.get("extensions", {}) for node in self.tree.get("nodes", []))
        for name in [*required, *([INSTANCING] if instanced else [])]:
            raise ValueError(
                f"a file that needs {name}, which is not read; {REMEDIES.get(name, 'export it without')}"
            )

    def _buffer(self, buffer: dict[str, Any]) -> bytes:
        content = self.chunk if buffer.get("uri") is None else self._resource(buffer["uri"])
        if len(content) < int(buffer["byteLength"]):
            raise ValueError(f"a buffer of {len(content)} bytes where it states {buffer['byteLength']}")
        return content

    def _resource(self, uri: str) -> bytes:
        if not uri.startswith("data:"):
            return self.siblings.get(uri.encode("utf-8", "replace"))
        head, _, body = uri.partition(",")
        return base64.b64decode(body) if head.endswith(";base64") else unquote(body).encode("latin-1")

    def _surface(self, material: dict[str, Any]) -> Surface:
        """Return a base colour, with opacity where it blends; grey in place of an unreadable picture."""
        stated = material.get("pbrMetallicRoughness", {})
        factor = [*np.clip(np.array(stated.get("baseColorFactor", []), float), 0, 1), 1.0, 1.0, 1.0, 1.0]
        colour, opacity = np.array(factor[:3]), factor[3] if material.get("alphaMode") == "BLEND" else 1.0
        if (texture := stated.get("baseColorTexture")) is None:
            return Surface(colour, None, opacity)
        source = self.tree["textures"][texture["index"]]
        number = source.get("extensions", {}).get(WEBP, source).get("source")
        image = {} if number is None else self.tree["images"][number]
        name = str(image.get("uri", image.get("name", f"picture {number}")))
        name = "a picture within the file" if name.startswith("data:") else name
        try:
            data = self._resource(image["uri"]) if "uri" in image else self._view(image["bufferView"])[0]
        except (KeyError, ValueError) as error:
            is_file = not str(image.get("uri", "data:")).startswith("data:")
            self.siblings.note(error if is_file else f"{name} is missing or unreadable")
            return Surface(GREY * colour, None, opacity)
        picture = self.siblings.decode(data, name)
        if picture is None:
            return Surface(GREY * colour, None, opacity)
        return Surface(colour, linear_picture(picture), opacity)

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
        """Return the stored numbers (count, size) of an accessor, its sparse ones in their places."""
        count, size = int(accessor["count"]), SIZES[accessor["type"]]
        kind = np.dtype(COMPONENTS[accessor["componentType"]])
        values = np.zeros((count, size), kind)
        if "bufferView" in accessor:
            content, view = self._view(accessor["bufferView"])
            values = _strided_rows(
                content, int(accessor.get("byteOffset", 0)), view.get("byteStride"), kind, count, size
            ).copy()
        if sparse := accessor.get("sparse"):
            places, new = sparse["indices"], sparse["values"]
            where = _strided_rows(
                self._view(places["bufferView"])[0], int(places.get("byteOffset", 0)), None,
                np.dtype(COMPONENTS[places["componentType"]]), int(sparse["count"]), 1,
            )[:, 0].astype(np.int64)  # fmt: skip
            if len(where) and where.max() >= count:
                raise ValueError(f"a sparse accessor of {count} with an index of {where.max()}")
            content = self._view(new["bufferView"])[0]
            values[where] = _strided_rows(
                content, int(new.get("byteOffset", 0)), None, kind, int(sparse["count"]), size
            )
        return values

    def _numbers(self, number: int) -> np.ndarray:
        """Return an accessor's values (count, size) as floats: whole numbers as fractions if it says so."""
        accessor = self.tree["accessors"][number]
        values = self._raw(accessor)
        if accessor["componentType"] == 5126 or not accessor.get("normalized", False):
            return values.astype(np.float64)
        return np.maximum(values.astype(np.float64) / np.iinfo(values.dtype).max, -1.0)

    def _primitive(self, primitive: dict[str, Any], weights: list[float]) -> SurfaceMesh:
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
        faces = _faces(indices, mode)
        if len(faces) and faces.max() >= len(positions):
            raise ValueError(f"a face with corner {faces.max()} of {len(positions)}")
        uv = self._coordinates(primitive, arrays)
        number = primitive.get("material")
        if number is not None and number not in self.surfaces:
            self.surfaces[number] = self._surface(self.tree["materials"][number])
        surface = None if number is None else self.surfaces[number]
        colours = None
        if "COLOR_0" in arrays and len(faces):
            fractions = arrays["COLOR_0"][faces][..., :3].mean(1)
            colours = np.clip(np.rint(255 * fractions), 0, 255).astype(np.uint8)
        return SurfaceMesh(positions, faces, uv, surface, colours, linear=True)

    def _check_bounds(self, accessor: dict[str, Any], positions: np.ndarray) -> None:
        """Raise ValueError where positions lie elsewhere than the file states: they were misread."""
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
        """Return triangle corners and arrays of a Draco-compressed primitive."""
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

    def _coordinates(self, primitive: dict[str, Any], arrays: dict[str, np.ndarray]) -> np.ndarray | None:
        """Return the texture coordinates of the material's colour, transformed, v upwards; None without."""
        if "material" not in primitive:
            return None
        surface = self.tree["materials"][primitive["material"]].get("pbrMetallicRoughness", {})
        texture = surface.get("baseColorTexture", {})
        place = texture.get("texCoord", 0)
        change = texture.get("extensions", {}).get(TRANSFORM)
        if change is not None:
            place = change.get("texCoord", place)
        coordinates = arrays.get(f"TEXCOORD_{place}")
        if coordinates is None:
            return None
        if change is not None:
            turn = float(change.get("rotation", 0.0))
            u, v = (coordinates * np.array(change.get("scale", [1.0, 1.0]), float)).T
            cos, sin = np.cos(turn), np.sin(turn)
            offset = np.array(change.get("offset", [0.0, 0.0]), float)
            coordinates = np.stack([cos * u + sin * v, -sin * u + cos * v], axis=1) + offset
        return coordinates * [1.0, -1.0] + [0.0, 1.0]


def _matrix(node: dict[str, Any]) -> np.ndarray:
    """Return a node's transform (4, 4) into its parent's frame."""
    if "matrix" in node:
        return np.array(node["matrix"], float).reshape(4, 4).T
    matrix = np.eye(4)
    turn = Rotation.from_quat(node.get("rotation", [0.0, 0.0, 0.0, 1.0])).as_matrix()
    matrix[:3, :3] = turn * np.array(node.get("scale", [1.0, 1.0, 1.0]), float)
    matrix[:3, 3] = node.get("translation", [0.0, 0.0, 0.0])
    return matrix


def _place(mesh: SurfaceMesh, frame: np.ndarray, names: tuple[str, ...]) -> SurfaceMesh:
    """Return a mesh moved into a frame (4, 4), turned back where that mirrors it."""
    vertices = mesh.vertices @ frame[:3, :3].T + frame[:3, 3]
    faces = mesh.faces[:, ::-1] if np.linalg.det(frame[:3, :3]) < 0 else mesh.faces
    return replace(mesh, vertices=vertices, faces=faces, names=names)


def _use_diffuse(material: dict[str, Any]) -> None:
    """Replace a material's base colour by that of specular and glossiness, where it has these."""
    if gloss := material.get("extensions", {}).get(GLOSSINESS):
        names = {"diffuseFactor": "baseColorFactor", "diffuseTexture": "baseColorTexture"}
        material["pbrMetallicRoughness"] = {new: gloss[old] for old, new in names.items() if old in gloss}


def _strided_rows(
    content: bytes, start: int, stride: int | None, kind: np.dtype, count: int, size: int
) -> np.ndarray:
    """Return numbers (count, size) of a view, its rows `stride` bytes apart or one behind the other."""
    stride = stride or kind.itemsize * size
    last = start + stride * (count - 1) + kind.itemsize * size
    if count < 0 or start < 0 or (count and last > len(content)):
        raise ValueError(f"an accessor of {count} values beyond its view")
    strides = stride, kind.itemsize
    return np.ndarray((count, size), kind, content, start, strides) if count else np.zeros((0, size), kind)


def _faces(indices: np.ndarray, mode: int) -> np.ndarray:
    """Return triangles (F, 3) of a primitive's indices."""
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
