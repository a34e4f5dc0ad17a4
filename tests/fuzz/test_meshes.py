"""Damaged meshes of users: pieces whose faces name their vertices, or one line."""

from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

from tests.fuzz.mutations import REVIEW_ORDER, damaged, damaged_json, outcomes, read_damaged
from vig.io.errors import UserError
from vig_world.assets.own.load import load
from vig_world.assets.own.settings import settings_of


def loaded(path: Path) -> None:
    for piece in load(path.parent, path).pieces:
        assert np.isfinite(piece.vertices).all() and piece.faces.min() >= 0
        assert piece.faces.max() < len(piece.vertices) == len(piece.uv)


@pytest.mark.parametrize("suffix", ["obj", "ply", "off", "stl", "glb"])
def test_damaged_meshes(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"a.{suffix}"
    trimesh.creation.box((0.1, 0.2, 0.3)).export(path)
    read_damaged(path, damaged, loaded, 100, 1, 10)


def test_damaged_scenes(tmp_path: Path) -> None:
    """The JSON of a .gltf, its buffer in the same text."""
    path = tmp_path / "a.gltf"
    files = trimesh.exchange.gltf.export_gltf(trimesh.Scene(trimesh.creation.box((0.1, 0.2, 0.3))))
    for name, content in files.items():
        (tmp_path / name).write_bytes(content)
    path.write_bytes(files["model.gltf"])
    read_damaged(path, damaged_json, loaded, 100, 2, 20)


MATERIALS = {
    "m.mtl": b"# \xfcber\nnewmtl a\nKd 0.8 0.1 0.1\nd 0.5\nTr 1\nmap_Kd -s 1 1 1 -o 0 0 t.png\nmap_d t.png\n"
    b"newmtl b\nKd 0 1 0\n",
    "a.obj": b"mtllib m.mtl n.mtl\nusemtl a\n"
    b"v 0 0 0 1 0 0\nv 1 0 0 0 1 0\nv 0 1 0 0 0 1\nvt 0 0\nvt 1 0\nvt 0 1\n"
    b"f 1/1 2/2 3/3\nusemtl \xe7\xba\xa2 # b\nf 3/3 2/2 1/1\n",
    "a.ply": b"ply\nformat ascii 1.0\n"
    b"comment TextureFile t.png\ncomment TextureFile u.png\nelement vertex 3\n"
    b"property float x\nproperty float y\nproperty float z\nproperty float s\nproperty float t\n"
    b"property uchar red\nproperty uchar green\nproperty uchar blue\nelement face 2\n"
    b"property list uchar int vertex_indices\nproperty list uchar float texcoord\nproperty int texnumber\n"
    b"end_header\n0 0 0 0 0 9 9 9\n1 0 0 1 0 9 9 9\n0 1 0 0 1 9 0 9\n3 0 1 2 6 0 0 1 0 0 1 0\n"
    b"3 2 1 0 6 0 1 1 0 0 0 1\n",
}


@pytest.mark.parametrize("name", MATERIALS)
def test_damaged_materials(name: str, tmp_path: Path, count: int = 50) -> None:
    """An MTL library, an OBJ that names it, and a PLY with pictures; a damaged library costs no mesh."""
    for file, data in MATERIALS.items():
        (tmp_path / file).write_bytes(data)
    Image.new("RGBA", (4, 4), (200, 20, 20, 99)).save(tmp_path / "t.png")
    mesh = tmp_path / ("a.ply" if name == "a.ply" else "a.obj")
    for kept in {0, max(MATERIALS[name].find(b"end_header"), 0)}:  # the header stays in half of the mutants

        def damaged_behind(data: bytes, rng: np.random.Generator, kept: int = kept) -> bytes:
            return data[:kept] + damaged(data[kept:], rng)

        counts = read_damaged(tmp_path / name, damaged_behind, lambda _: loaded(mesh), count, 3, -1)
        assert counts["accepted"] == count or name != "m.mtl"


@pytest.mark.parametrize(
    "face",
    [" 1 2 3" * 700_000, " 1/1/1 2/2/2\t3/3/3" * 700_000, " 1 2 3\\\n" * 700_000],
    ids=["long", "tabs", "goes on"],
)
def test_a_polygon_of_millions_of_corners(face: str, tmp_path: Path) -> None:
    path = tmp_path / "a.obj"
    path.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf" + face + "\n")
    with pytest.raises(UserError, match="expected at most 1,000,000 faces"):
        load(tmp_path, path)


def test_an_accessor_without_a_buffer_makes_no_memory(tmp_path: Path) -> None:
    path = tmp_path / "a.gltf"
    path.write_text(
        '{"asset": {"version": "2.0"}, "accessors": [{"componentType": 5126, "type": "VEC3", "count": 3},'
        '{"componentType": 5126, "type": "VEC4", "count": 4000000000}],'
        '"meshes": [{"primitives": [{"attributes": {"POSITION": 0, "COLOR_0": 1}}]}], "nodes": [{"mesh": 0}],'
        '"scenes": [{"nodes": [0]}]}'
    )
    with pytest.raises(UserError, match="its accessors hold 4000000003 values"):
        load(tmp_path, path)


def test_files_outside_the_folder_are_not_read(tmp_path: Path) -> None:
    """Named by a path that leads out, or by a link that does."""
    (tmp_path / "in").mkdir()
    (tmp_path / "secret.mtl").write_text("newmtl a\nKd 1 0 0\n")
    (tmp_path / "in" / "link.mtl").symlink_to(tmp_path / "secret.mtl")
    for name in ("../secret.mtl", str(tmp_path / "secret.mtl"), "link.mtl", "/dev/zero"):
        path = tmp_path / "in" / "a.obj"
        path.write_text(f"mtllib {name}\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl a\nf 1 2 3\n")
        held = load(tmp_path / "in", path)
        assert list(held.files) == ["a.obj"] and held.notes


def test_strange_settings(tmp_path: Path) -> None:
    """vig.toml with values of other types and sizes."""
    path = tmp_path / "a.obj"
    path.write_text("")
    texts = [
        "a = " + "[" * 50_000,
        "a." * 50_000 + "b = 1",
        "[defaults]\nscale = 1e999",
        "[defaults]\nturn = nan",
    ]
    for key in ("up", "scale", "turn", "zones", "family", "nodes", "skip", "other"):
        texts += [f"[defaults]\n{key} = {trial!r}".replace("True", "true") for trial in REVIEW_ORDER]
    texts += [f'[files."a.obj"]\nscale = {"9" * digits}' for digits in (5, 50, 5000)]

    def read(text: str) -> None:
        (tmp_path / "vig.toml").write_text(text)
        said = settings_of(tmp_path, path, {})
        assert said.scale is None or 0 < said.scale < 1e9

    counts = outcomes(texts, read)
    assert counts.total() == len(texts) > 200 and counts["refused"] > 150
