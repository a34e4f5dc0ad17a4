"""Assets on disk: the same as those made, whatever the folder holds."""

from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

from tests.support import TEAPOT
from vig.scene import ObjectClass
from vig_world import asset_cache as module
from vig_world import library as uses
from vig_world.asset_cache import Arrays, AssetCache, packed_text, unpacked_text
from vig_world.library import Library
from vig_world.raster.draw import depth
from vig_world.raster.items import Item
from vig_world.raster.view import View


def made() -> Arrays:
    return {"numbers": np.arange(6.0).reshape(2, 3).T, "bytes": np.arange(5, dtype=np.uint8)}


def test_arrays_are_made_once(tmp_path: Path) -> None:
    calls = []

    def make() -> Arrays:
        calls.append(1)
        return made()

    for _ in range(2):
        for name, array in AssetCache(tmp_path).arrays("train/prop/mug/3", make).items():
            np.testing.assert_array_equal(array, made()[name])
    assert len(calls) == 1


@pytest.mark.parametrize("content", [b"", b"{}", b"\x10\0\0\0\0\0\0\0{broken"])
def test_a_damaged_file_is_made_anew(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "a.safetensors"
    path.write_bytes(content)
    np.testing.assert_array_equal(AssetCache(tmp_path).arrays("a", made)["bytes"], made()["bytes"])
    assert path.read_bytes() != content


def test_a_folder_that_cannot_be_written_is_done_without(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    held = AssetCache(tmp_path / "file")
    np.testing.assert_array_equal(held.arrays("a", made)["bytes"], made()["bytes"])
    assert held.folder is None


def test_text_keeps_numbers_exactly() -> None:
    values = ["floor", [0.1 + 0.2, float("inf"), -3], None]
    assert unpacked_text(packed_text(values)) == values


def test_only_the_latest_versions_are_left(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    for version in ("a", "b", "c", "d"):
        monkeypatch.setattr(module, "_version", lambda version=version: version)
        assert module.asset_cache.__wrapped__().folder == tmp_path / "vig" / f"world-{version}"
    assert {path.name for path in (tmp_path / "vig").iterdir()} == {"world-b", "world-c", "world-d"}


def test_kept_assets_are_those_that_were_made(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of three libraries the first keeps nothing, the second writes, the third reads."""
    libraries = []
    for folder in (None, tmp_path, tmp_path):
        monkeypatch.setattr(uses, "asset_cache", lambda folder=folder: AssetCache(folder))
        library = Library("validation")
        for ask, what in (
            (library.plan, (1,)),
            (library.shape, ("vase", 2)),
            (library.radiance, (4,)),
            (library.light_parts, (4,)),
            (library.surface, ("plaster", 3)),
        ):
            ask(*what)
        libraries.append(library)
    assert len(list(tmp_path.rglob("*.safetensors"))) == 5
    first, view = libraries[0], View.of(ObjectClass.load(TEAPOT), 0.4, 0.3, 75)
    for other in libraries[1:]:
        for a, b in (
            (first.pack_prop("vase", 2), other.pack_prop("vase", 2)),
            (first.plan(1).packed, other.plan(1).packed),
        ):
            ours, theirs = (depth([Item(each, np.eye(3), np.zeros(3))], view)[0] for each in (a, b))
            np.testing.assert_array_equal(ours, theirs)
            assert a.slots == b.slots
        np.testing.assert_array_equal(first.extremes("vase", 2), other.extremes("vase", 2))
        np.testing.assert_array_equal(first.radiance(4), other.radiance(4))
        np.testing.assert_array_equal(first.light_parts(4), other.light_parts(4))
        np.testing.assert_array_equal(first.pyramid("plaster", 3).texels, other.pyramid("plaster", 3).texels)
        assert first.albedo("plaster", 3) == other.albedo("plaster", 3)
        assert first.plan(1).grounds == other.plan(1).grounds
        for field in fields(first.plan(1).layout):
            ours, theirs = (getattr(each.plan(1).layout, field.name) for each in (first, other))
            np.testing.assert_equal(ours, theirs)
