"""Damaged meshes of users: pieces whose faces name their vertices, or one line."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import trimesh

from tests.fuzz.mutations import REVIEW_ORDER, damaged, outcomes
from vig.io.errors import UserError
from vig_world.assets.own.load import load
from vig_world.assets.own.settings import settings_of


def mutants(data: bytes, path: Path, count: int, seed: int) -> Iterator[Path]:
    rng = np.random.default_rng(seed)
    for _ in range(count):
        path.write_bytes(damaged(data, rng))
        yield path


def loaded(path: Path) -> None:
    for piece in load(path.parent, path).pieces:
        assert np.isfinite(piece.vertices).all() and piece.faces.min() >= 0
        assert piece.faces.max() < len(piece.vertices) == len(piece.uv)


@pytest.mark.parametrize("suffix", ["obj", "ply", "off", "stl", "glb"])
def test_damaged_meshes(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"a.{suffix}"
    trimesh.creation.box((0.1, 0.2, 0.3)).export(path)
    data = path.read_bytes()
    loaded(path)
    counts = outcomes(mutants(data, path, 200, 1), loaded)
    assert counts.total() == 200 and counts["refused"] > 20


def test_damaged_scenes(tmp_path: Path) -> None:
    """The JSON of a .gltf, its buffer in the same text."""
    path = tmp_path / "a.gltf"
    files = trimesh.exchange.gltf.export_gltf(trimesh.Scene(trimesh.creation.box((0.1, 0.2, 0.3))))
    for name, content in files.items():
        (tmp_path / name).write_bytes(content)
    path.write_bytes(files["model.gltf"])
    loaded(path)
    from tests.fuzz.mutations import damaged_json

    rng, whole = np.random.default_rng(2), path.read_bytes()

    def read(_: int) -> None:
        path.write_bytes(damaged_json(whole, rng))
        loaded(path)

    counts = outcomes(range(300), read)
    assert counts.total() == 300 and counts["refused"] > 60


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
