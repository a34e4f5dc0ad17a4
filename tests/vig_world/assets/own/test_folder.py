import os
import unicodedata
from pathlib import Path

import pytest

from vig.io.errors import UserError
from vig_world.assets.own.folder import files_of, fingerprint


def test_links_are_followed_and_each_folder_is_listed_once(tmp_path: Path) -> None:
    root, other = tmp_path / "meshes", tmp_path / "other"
    for path in (root / "a" / "1.obj", other / "x" / "2.OBJ", root / ".git" / "3.obj", root / "notes.txt"):
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch()
    (root / "e").symlink_to(other)
    (root / "again").symlink_to(root / "a")
    (root / "4.obj").symlink_to(other / "x" / "2.OBJ")
    (root / "a" / "up").symlink_to(root)  # a circle
    (root / "self").symlink_to("self")
    (root / "gone.obj").symlink_to("nowhere.obj")
    os.mkfifo(root / "pipe.obj")
    assert [name for name, _ in files_of(root, (".obj",))] == ["4.obj", "a/1.obj", "e/x/2.OBJ", "gone.obj"]


def test_names_are_composed_and_none_is_lost(tmp_path: Path) -> None:
    decomposed = unicodedata.normalize("NFD", "Kännchen")
    (tmp_path / f"{decomposed}.obj").touch()
    assert [name for name, _ in files_of(tmp_path, (".obj",))] == ["Kännchen.obj"]
    (tmp_path / "Kännchen.obj").touch()
    listed = files_of(tmp_path, (".obj",))
    assert sorted(path for _, path in listed) == sorted(tmp_path.iterdir())
    assert {name for name, _ in listed} == {"Kännchen.obj", f"{decomposed}.obj"}


def test_names_of_bytes_that_are_no_text_can_be_printed_and_written(tmp_path: Path) -> None:
    (Path(os.fsdecode(os.fsencode(tmp_path) + b"/caf\xe9\n.obj"))).write_text("x")
    ((name, path),) = files_of(tmp_path, (".obj",))
    assert name.isprintable() and name.encode() and path.read_text() == "x"
    assert len(fingerprint({path.name: path})) == 64


def test_what_is_there_instead_is_named(tmp_path: Path) -> None:
    for name in ("a.fbx", "b.fbx", "c.zip"):
        (tmp_path / name).touch()
    with pytest.raises(UserError, match=r"expected files .obj; got 2 .fbx, 1 .zip"):
        files_of(tmp_path, (".obj",), also=(".fbx",))
    (tmp_path / "d.obj").touch()
    assert [name for name, _ in files_of(tmp_path, (".obj",), also=(".fbx",))] == ["a.fbx", "b.fbx", "d.obj"]
