"""Mesh files as programs write them: each is read as its format says, or refused by what it needs.

The shapes are a box of 1 x 2 x 3 (area 22) and a C, 3 x 3 x 1 less a mouth of 2 x 1 (area 2 * 7 + 16 = 30).
"""

import json
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from vig.io.errors import UserError
from vig_train.building.reading import read_scans
from vig_world.assets.own.load import load
from vig_world.assets.own.meshes.polygons import triangulate
from vig_world.mesh import face_normals

BOX = trimesh.creation.box((1, 2, 3))
POINTS, FACES = np.asarray(BOX.vertices, np.float32), np.asarray(BOX.faces)
OUTLINE = np.array([[0, 0], [3, 0], [3, 1], [1, 1], [1, 2], [3, 2], [3, 3], [0, 3]], float)
C_POINTS = np.concatenate([np.c_[OUTLINE, np.zeros(8)], np.c_[OUTLINE, np.ones(8)]])
C_FACES = [list(range(7, -1, -1)), list(range(8, 16))]
C_FACES += [[k, (k + 1) % 8, 8 + (k + 1) % 8, 8 + k] for k in range(8)]


def area_and_volume(path: Path) -> tuple[float, float]:
    """Of all pieces; the volume has its sign from the sense of the faces."""
    area = volume = 0.0
    for piece in load(path.parent, path).pieces:
        area += float(np.linalg.norm(face_normals(piece.vertices, piece.faces), axis=1).sum()) / 2
        volume += float(np.linalg.det(piece.vertices[piece.faces]).sum()) / 6
    return area, volume


def is_box(path: Path) -> None:
    assert area_and_volume(path) == pytest.approx((22, 6), rel=1e-3)


def is_c(path: Path) -> None:
    assert area_and_volume(path) == pytest.approx((30, 7), rel=1e-6)


def refusal(path: Path) -> str:
    with pytest.raises(UserError) as caught:
        load(path.parent, path)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_polygons_are_cut_by_their_shape() -> None:
    """A dart, whose fan from its first corner would cover what is outside it; and an L of six corners."""
    dart = np.array([[0, 0, 0], [2, -1, 0], [1, 0, 0], [2, 1, 0.0]])
    shape = np.array([[2, 0, 0], [2, 1, 0], [1, 1, 0], [1, 2, 0], [0, 2, 0], [0, 0, 0.0]])
    for polygon, area in ((dart, 1.0), (np.roll(dart, 1, 0), 1.0), (shape, 3.0), (np.roll(shape, 2, 0), 3.0)):
        faces = triangulate(polygon, [np.arange(len(polygon))])
        normals = face_normals(polygon, faces)
        assert len(faces) == len(polygon) - 2
        assert (normals[:, 2] >= 0).all() and normals[:, 2].sum() / 2 == pytest.approx(area)


def obj(points: np.ndarray, faces: list[list[int]], first: int = 1) -> str:
    rows = [f"v {x} {y} {z}" for x, y, z in points.tolist()]
    return "\n".join([*rows, *("f " + " ".join(str(i + first) for i in face) for face in faces)]) + "\n"


PLAIN = obj(POINTS, FACES.tolist())
OBJ: dict[str, bytes] = {
    "plain": PLAIN.encode(),
    "byte order mark": b"\xef\xbb\xbf" + PLAIN.encode(),
    "utf-16": PLAIN.encode("utf-16"),
    "tabs": PLAIN.replace(" ", "\t").encode(),
    "comments": PLAIN.replace("\n", " # 1 2 3\n").encode(),
    "carriage returns": PLAIN.replace("\n", "\r\n").encode(),
    "continued": PLAIN.replace(" ", " \\\n").replace("v \\\n", "v ").encode(),
    "from the end": obj(POINTS, (FACES - len(POINTS)).tolist(), 0).encode(),
    "with normals": (PLAIN.replace("f ", "vn 0 0 1\nf ", 1).replace("f ", "f ")).encode(),
    "colours": "\n".join(
        line + " 0.5 0.5 0.5" if line.startswith("v ") else line for line in PLAIN.splitlines()
    ).encode(),
}


@pytest.mark.parametrize("kind", OBJ)
def test_obj_in_any_usual_form_is_a_box(kind: str, tmp_path: Path) -> None:
    (tmp_path / "a.obj").write_bytes(OBJ[kind])
    is_box(tmp_path / "a.obj")


def test_obj_that_counts_from_0_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.obj").write_text(obj(POINTS, FACES.tolist(), 0))
    assert "OBJ counts from 1" in refusal(tmp_path / "a.obj")
    (tmp_path / "a.obj").write_text(obj(POINTS, [[0, 1, 99]]))
    assert "of 8 vertices" in refusal(tmp_path / "a.obj")


def test_concave_faces_are_themselves_in_every_format(tmp_path: Path) -> None:
    (tmp_path / "a.obj").write_text(obj(C_POINTS, C_FACES))
    counts = f"{len(C_POINTS)} {len(C_FACES)} 0"
    points = "\n".join(" ".join(map(str, row)) for row in C_POINTS.tolist())
    faces = "\n".join(" ".join(map(str, [len(face), *face])) for face in C_FACES)
    (tmp_path / "a.off").write_text(f"OFF\n{counts}\n{points}\n{faces}\n")
    (tmp_path / "b.off").write_text(
        f"OFF {counts} # a C\n\n{points}\n# faces\n{faces.replace('4 ', '4  ')}\n"
    )
    coloured = "\n".join(f"{row} 255 0 0 255" for row in points.splitlines())
    (tmp_path / "c.off").write_text(f"COFF\n{counts}\n{coloured}\n{faces}\n")
    header = (
        f"ply\nformat ascii 1.0\nelement vertex {len(C_POINTS)}\nproperty float x\nproperty float y\n"
        f"property float z\nelement face {len(C_FACES)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    (tmp_path / "a.ply").write_text(f"{header}{points}\n{faces}\n")
    (tmp_path / "b.ply").write_text(f"{header.replace('vertex_indices', 'vertex_index')}{points}\n{faces}\n")
    for path in sorted(tmp_path.iterdir()):
        is_c(path)


@pytest.mark.parametrize(
    ("header", "words"),
    [("OFF BINARY", "binary OFF"), ("4OFF", "four or more"), ("OFF\n8 12 0\n0 0 0", "lines")],
)
def test_off_of_other_kinds_is_named(header: str, words: str, tmp_path: Path) -> None:
    (tmp_path / "a.off").write_text(f"{header}\n8 12 0\n")
    assert words in refusal(tmp_path / "a.off")


def binary_stl(head: bytes = b"") -> bytes:
    data = head.ljust(80, b" ") + struct.pack("<I", len(FACES))
    for corners in POINTS[FACES]:
        data += struct.pack("<12fH", 0, 0, 0, *corners.ravel().tolist(), 0)
    return data


TEXT_STL = "solid box\n" + "".join(
    "facet normal 0 0 0\nouter loop\n"
    + "".join(f"vertex {x:e} {y:e} {z:e}\n" for x, y, z in corners)
    + "endloop\nendfacet\n"
    for corners in POINTS[FACES].tolist()
)
STL: dict[str, bytes] = {
    "binary": binary_stl(),
    "binary that says solid": binary_stl(b"solid box"),
    "binary, bytes behind": binary_stl() + b"\0" * 7,
    "binary that says solid, bytes behind": binary_stl(b"solid\0by a program") + b"\0\0",
    "text": (TEXT_STL + "endsolid box\n").encode(),
    "upper case": (TEXT_STL + "endsolid box\n").upper().encode(),
    "byte order mark": b"\xef\xbb\xbf" + TEXT_STL.encode(),
    "blanks before": b"\n  " + TEXT_STL.encode(),
    "several solids": (TEXT_STL[: len(TEXT_STL) // 2].rsplit("facet normal", 1)[0] + "endsolid\nsolid b\n"
                       + "facet normal" + TEXT_STL[: len(TEXT_STL) // 2].rsplit("facet normal", 1)[1]
                       + TEXT_STL[len(TEXT_STL) // 2 :]).encode(),
    "words behind": (TEXT_STL + "endsolid box\nmade by a program\n").encode(),
}  # fmt: skip


@pytest.mark.parametrize("kind", STL)
def test_stl_in_any_usual_form_is_a_box(kind: str, tmp_path: Path) -> None:
    (tmp_path / "A.STL").write_bytes(STL[kind])
    is_box(tmp_path / "A.STL")


def test_stl_that_is_cut_off_is_refused(tmp_path: Path) -> None:
    for data in (binary_stl()[:-30], TEXT_STL.encode().rsplit(b"vertex", 1)[0] + b"vertex 1 2"):
        (tmp_path / "a.stl").write_bytes(data)
        refusal(tmp_path / "a.stl")


@pytest.mark.parametrize("form", ["ascii", "binary_little_endian", "binary_big_endian"])
def test_plys_strips_and_colours(form: str, tmp_path: Path) -> None:
    """Two strips of a tetrahedron of edge sqrt 2, area 2 sqrt 3, volume 1 / 3: 0 1 2 3 and 2 1 0 3 less their
    common pairs of faces.
    """
    from plyfile import PlyData, PlyElement

    corners = np.array([[0, 0, 0], [1, 1, 0], [1, 0, 1], [0, 1, 1.0]])
    points = np.zeros(4, [(axis, "f4") for axis in "xyz"] + [(c, "u1") for c in ("red", "green", "blue")])
    for axis, values in zip("xyz", corners.T, strict=True):
        points[axis] = values
    points["red"] = 255
    strips = np.zeros(1, [("vertex_indices", "O")])
    strips["vertex_indices"][0] = np.array([0, 1, 2, 3, 0, 1], "i4")  # (0 1 2) (1 3 2) (2 3 0) (3 1 0)
    elements = [PlyElement.describe(points, "vertex"), PlyElement.describe(strips, "tristrips")]
    order = {"binary_little_endian": "<", "binary_big_endian": ">"}.get(form, "=")
    path = tmp_path / "a.ply"
    PlyData(elements, text=form == "ascii", byte_order=order).write(str(path))
    area, volume = area_and_volume(path)
    assert area == pytest.approx(2 * np.sqrt(3), rel=1e-6) and abs(volume) == pytest.approx(1 / 3, rel=1e-6)
    (piece,) = load(tmp_path, path).pieces
    assert (piece.texture[..., 0] > 0.5).all() and (piece.texture[..., 1] < 0.2).all()


class Scene:
    """A .gltf with its buffer beside it, put together by hand."""

    def __init__(self, folder: Path):
        self.path, self.data = folder / "a.gltf", b""
        self.tree: dict[str, Any] = {
            "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
            "meshes": [{"primitives": [{"attributes": {}}]}], "accessors": [], "bufferViews": [],
        }  # fmt: skip

    @property
    def primitive(self) -> dict[str, Any]:
        found: dict[str, Any] = self.tree["meshes"][0]["primitives"][0]
        return found

    def view(self, content: bytes, **more: Any) -> int:
        self.tree["bufferViews"].append(
            {"buffer": 0, "byteOffset": len(self.data), "byteLength": len(content)} | more
        )
        self.data += content + b"\0" * (-len(content) % 4)
        return len(self.tree["bufferViews"]) - 1

    def accessor(self, values: np.ndarray, kind: int, form: str, bounds: bool = False, **more: Any) -> int:
        accessor = {"bufferView": self.view(values.tobytes()), "componentType": kind, "count": len(values)}
        if bounds:
            accessor |= {"min": values.min(0).tolist(), "max": values.max(0).tolist()}
        self.tree["accessors"].append(accessor | {"type": form} | more)
        return len(self.tree["accessors"]) - 1

    def box(self, kind: int = 5123) -> None:
        self.primitive["attributes"]["POSITION"] = self.accessor(POINTS, 5126, "VEC3", True)
        dtype = {5121: "u1", 5123: "<u2", 5125: "<u4"}[kind]
        self.primitive["indices"] = self.accessor(FACES.astype(dtype).ravel(), kind, "SCALAR")

    def write(self) -> Path:
        self.path.with_suffix(".bin").write_bytes(self.data)
        self.tree["buffers"] = [{"uri": "a.bin", "byteLength": len(self.data)}]
        self.path.write_text(json.dumps(self.tree))
        return self.path


def _indices(kind: int) -> Callable[[Scene], None]:
    return lambda scene: scene.box(kind)


def _unindexed(scene: Scene) -> None:
    corners = POINTS[FACES.ravel()]
    scene.primitive["attributes"]["POSITION"] = scene.accessor(corners, 5126, "VEC3", True)


def _normalised(scene: Scene) -> None:
    """Within 1.5 of the origin, as 16-bit fractions of that."""
    scene.box()
    stored = np.rint(POINTS / 1.5 * 32767).astype("<i2")
    padded = np.zeros((len(stored), 4), "<i2")  # rows are multiples of four bytes
    padded[:, :3] = stored
    view = scene.view(padded.tobytes(), byteStride=8)
    scene.tree["accessors"][0] = {
        "bufferView": view, "componentType": 5122, "count": len(stored), "type": "VEC3", "normalized": True,
        "min": stored.min(0).tolist(), "max": stored.max(0).tolist(),
    }  # fmt: skip
    scene.tree["nodes"][0]["scale"] = [1.5, 1.5, 1.5]
    scene.tree |= {"extensionsRequired": ["KHR_mesh_quantization"]}


def _whole_numbers(scene: Scene) -> None:
    """Positions as bytes that are no fractions: 0 to 2, 4, 6, made half as large and moved."""
    _normalised(scene)
    stored = np.zeros((8, 4), "u1")
    stored[:, :3] = np.rint(2 * (POINTS - POINTS.min(0)))
    view = scene.view(stored.tobytes(), byteStride=4)
    scene.tree["accessors"][0] = {
        "bufferView": view, "componentType": 5121, "count": 8, "type": "VEC3",
        "min": [0, 0, 0], "max": [2, 4, 6],
    }  # fmt: skip
    scene.tree["nodes"][0] = {"mesh": 0, "scale": [0.5] * 3, "translation": [-0.5, -1, -1.5]}


def _sparse(scene: Scene) -> None:
    """All at 0 but for what the sparse values say."""
    scene.box()
    accessor = scene.tree["accessors"][0]
    del accessor["bufferView"]
    accessor["sparse"] = {
        "count": 8,
        "indices": {"bufferView": scene.view(np.arange(8, dtype="u1").tobytes()), "componentType": 5121},
        "values": {"bufferView": scene.view(POINTS.tobytes())},
    }


def _interleaved(scene: Scene) -> None:
    """Positions between other numbers, and beginning behind them."""
    scene.box()
    rows = np.full((8, 6), 9, "<f4")
    rows[:, 3:] = POINTS
    scene.tree["accessors"][0] |= {"bufferView": scene.view(rows.tobytes(), byteStride=24), "byteOffset": 12}


def _morphed(scene: Scene) -> None:
    """A box half as wide, whose first target makes it wider by as much; the second has no weight."""
    scene.box()
    narrow = POINTS * np.float32([0.5, 1, 1])
    scene.primitive["attributes"]["POSITION"] = scene.accessor(narrow, 5126, "VEC3", True)
    targets = [scene.accessor((POINTS - narrow) * 2, 5126, "VEC3"), scene.accessor(POINTS, 5126, "VEC3")]
    scene.primitive["targets"] = [{"POSITION": number} for number in targets]
    scene.tree["meshes"][0]["weights"] = [0.5, 0.0]


def _morphed_by_its_node(scene: Scene) -> None:
    _morphed(scene)
    scene.tree["meshes"][0]["weights"] = [0.0, 0.0]
    scene.tree["nodes"][0]["weights"] = [0.5, 0.0]


def _strips_and_fans(scene: Scene) -> None:
    """The sides as one strip, top and bottom as fans."""
    low, high = ([np.flatnonzero((POINTS == [x, y, z]).all(1))[0] for x, y in CORNERS] for z in (-1.5, 1.5))
    scene.box()
    position = scene.primitive["attributes"]["POSITION"]
    strip = [index for k in range(5) for index in (high[k % 4], low[k % 4])]
    parts = [(5, strip), (6, high), (6, low[::-1])]
    scene.tree["meshes"][0]["primitives"] = [
        {
            "mode": mode,
            "attributes": {"POSITION": position},
            "indices": scene.accessor(np.array(indices, "<u2"), 5123, "SCALAR"),
        }
        for mode, indices in parts
    ]


CORNERS = ((-0.5, -1.0), (0.5, -1.0), (0.5, 1.0), (-0.5, 1.0))


def _with_lines(scene: Scene) -> None:
    scene.box()
    scene.tree["meshes"][0]["primitives"].append(scene.primitive | {"mode": 1})


def _draco(scene: Scene) -> None:
    DracoPy = pytest.importorskip("DracoPy")
    scene.box()
    content = DracoPy.encode(POINTS, FACES.astype(np.uint32), quantization_bits=14)
    view = scene.view(content)
    scene.primitive["extensions"] = {
        "KHR_draco_mesh_compression": {"bufferView": view, "attributes": {"POSITION": 0}}
    }
    for accessor in scene.tree["accessors"]:
        del accessor["bufferView"]
    scene.tree |= {"extensionsRequired": ["KHR_draco_mesh_compression"]}


GLTF: dict[str, Callable[[Scene], None]] = {
    "bytes": _indices(5121),
    "shorts": _indices(5123),
    "words": _indices(5125),
    "unindexed": _unindexed,
    "normalised": _normalised,
    "whole numbers": _whole_numbers,
    "sparse": _sparse,
    "interleaved": _interleaved,
    "morphed": _morphed,
    "morphed by its node": _morphed_by_its_node,
    "strips and fans": _strips_and_fans,
    "with lines": _with_lines,
    "draco": _draco,
}


@pytest.mark.parametrize("kind", GLTF)
def test_gltf_in_any_usual_form_is_a_box(kind: str, tmp_path: Path) -> None:
    scene = Scene(tmp_path)
    GLTF[kind](scene)
    is_box(scene.write())


@pytest.mark.parametrize(
    "name",
    ["EXT_meshopt_compression", "EXT_mesh_gpu_instancing", "KHR_texture_basisu", "VENDOR_displacement"],
)
def test_what_a_gltf_needs_and_is_not_read_is_named(name: str, tmp_path: Path) -> None:
    scene = Scene(tmp_path)
    scene.box()
    scene.tree |= {"extensionsUsed": [name], "extensionsRequired": [name]}
    assert f"needs {name}, which is not read; " in refusal(scene.write())


def test_gltf_that_would_lose_what_it_shows_is_refused(tmp_path: Path) -> None:
    """Instances that are not required, a skin, positions that are not where the file says, a short buffer."""
    scene = Scene(tmp_path)
    scene.box()
    scene.tree["nodes"][0]["extensions"] = {"EXT_mesh_gpu_instancing": {"attributes": {}}}
    assert "EXT_mesh_gpu_instancing" in refusal(scene.write())
    scene.tree["nodes"][0] = {"mesh": 0, "skin": 0}
    assert "skinned" in refusal(scene.write())
    scene.tree["nodes"][0] = {"mesh": 0}
    scene.tree["accessors"][0]["max"] = [0.5, 1.0, 2.0]
    assert "where it states" in refusal(scene.write())
    scene.tree["accessors"][0]["max"] = [0.5, 1.0, 1.5]
    is_box(scene.write())
    scene.path.with_suffix(".bin").write_bytes(scene.data[:40])
    assert "a buffer of 40 bytes" in refusal(scene.path)


@pytest.mark.parametrize(
    ("names", "extension", "scene_nodes"),
    [
        (("box_LOD0", "box_LOD1"), {}, [0, 1]),
        (("box", "UCX_box"), {}, [0, 1]),
        (("a", "b"), {"MSFT_lod": {"ids": [1]}}, [0, 1]),
        (("a", "b"), {}, [0]),
    ],
    ids=["level", "hull", "extension", "other scene"],
)
def test_a_node_that_repeats_another_or_is_not_shown_is_left_out(
    names: tuple[str, str], extension: dict[str, Any], scene_nodes: list[int], tmp_path: Path
) -> None:
    """The second node is a single triangle, twice as large."""
    scene = Scene(tmp_path)
    scene.box()
    corners = {"POSITION": scene.accessor(np.float32([[0, 0, 0], [4, 0, 0], [0, 4, 0]]), 5126, "VEC3", True)}
    scene.tree["meshes"].append({"primitives": [{"attributes": corners}]})
    scene.tree["nodes"] = [
        {"mesh": number, "name": name} | ({"extensions": extension} if number == 0 else {})
        for number, name in enumerate(names)
    ]
    scene.tree["scenes"] = [{"nodes": scene_nodes}]
    is_box(scene.write())
    loaded = load(tmp_path, scene.path)
    by_name = names[0] != "a"
    assert [names[1] in note and names[0] in note for note in loaded.notes] == [True] * by_name
    if by_name:
        assert sum(len(piece.faces) for piece in load(tmp_path, scene.path, (names[1],)).pieces) == 1


def test_a_texture_is_where_its_transform_puts_it(tmp_path: Path) -> None:
    """The right half of a picture, red and blue, is blue."""
    from PIL import Image

    Image.fromarray(np.uint8([[[255, 0, 0]] * 8 + [[0, 0, 255]] * 8] * 16)).save(tmp_path / "a.png")
    scene = Scene(tmp_path)
    scene.box()
    coordinates = np.tile(np.float32([[0.1, 0.1], [0.9, 0.9], [0.1, 0.9], [0.9, 0.1]]), (2, 1))
    scene.primitive["attributes"]["TEXCOORD_0"] = scene.accessor(coordinates, 5126, "VEC2")
    scene.primitive["material"] = 0
    transform = {"KHR_texture_transform": {"offset": [0.5, 0.0], "scale": [0.5, 1.0]}}
    colour = {"baseColorTexture": {"index": 0, "extensions": transform}}
    scene.tree |= {
        "materials": [{"pbrMetallicRoughness": colour}],
        "textures": [{"source": 0}],
        "images": [{"uri": "a.png"}],
        "extensionsRequired": ["KHR_texture_transform"],
    }
    (piece,) = load(tmp_path, scene.write()).pieces
    assert piece.uv[:, 0].min() == pytest.approx(0.55) and piece.uv[:, 0].max() == pytest.approx(0.95)
    assert piece.texture[0, -1, 2] > 0.5 > piece.texture[0, -1, 0]


def test_what_is_passed_over_in_a_folder_is_named(tmp_path: Path) -> None:
    """Other formats, but not those of meshes that are read; copies; a damaged finest level is replaced."""
    for number in (1, 2):
        trimesh.creation.box((1, 2, 2 + number)).subdivide().export(tmp_path / f"{number}_LOD0.obj")
        trimesh.creation.box((1, 2, 2.3 + number)).export(tmp_path / f"{number}_LOD1.obj")
    (tmp_path / "2_LOD0.obj").write_text("v 0 0\n")
    for name in ("3.fbx", "4.step", "1_LOD0.blend", "1_LOD0.mtl", "read me.txt"):
        (tmp_path / name).touch()
    scans, refused = read_scans(tmp_path)
    assert [scan.name for scan in scans] == ["1_LOD0.obj", "2_LOD1.obj"]
    assert set(refused) == {"1_LOD1.obj", "2_LOD0.obj", "3.fbx", "4.step"}
    assert "1_LOD0.obj" in refused["1_LOD1.obj"] and refused["3.fbx"] == refused["4.step"]
    for name, words in (("3.fbx", r"\.glb \.gltf .* got '.*3\.fbx'"), ("5.obj", "got nothing of that name")):
        with pytest.raises(UserError, match=words):
            read_scans(tmp_path / name)


def test_one_shape_in_several_files_counts_once(tmp_path: Path) -> None:
    """In other units, axes and formats, mirrored and shuffled; a box of other proportions is another."""
    BOX.export(tmp_path / "a.obj")
    BOX.export(tmp_path / "b.stl")
    large = BOX.copy()
    large.apply_transform(trimesh.transformations.rotation_matrix(1.0, [1, 2, 3]))
    large.apply_scale(1000)
    large.export(tmp_path / "c.ply")
    mirrored = BOX.copy()
    mirrored.apply_transform(np.diag([-1.0, 1, 1, 1]))
    mirrored.faces = mirrored.faces[::-1]
    mirrored.export(tmp_path / "d.off")
    trimesh.creation.box((1, 2, 3.02)).export(tmp_path / "e.glb")
    scans, refused = read_scans(tmp_path)
    assert [scan.name for scan in scans] == ["a.obj", "e.glb"]
    assert refused == dict.fromkeys(("b.stl", "c.ply", "d.off"), "the same shape as a.obj, which counts once")
