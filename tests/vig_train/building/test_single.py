"""A class of one mesh file, as `vig fit --mesh` makes it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.vig_train.building.things import finned
from vig.io.errors import UserError
from vig.recognition import UninformedRecognizer
from vig.scene import ObjectClass
from vig_app.cli.boxes import classes_of
from vig_app.cli.common import FitCommand
from vig_train.building import single
from vig_train.building.single import pack_of_mesh
from vig_world.asset_cache import AssetCache


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(single, "asset_cache", lambda: AssetCache(tmp_path / "cache"))
    return tmp_path / "cache" / "meshes"


@pytest.mark.slow
def test_a_mesh_becomes_a_pack_once(cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from vig import Explainer

    file = tmp_path / "thing.ply"
    finned(1.0, 1.5, 0.45).export(file)
    pack = pack_of_mesh(file)
    explainer = Explainer(pack)
    assert explainer.object_class.name == "thing" and explainer.object_class.shape_model.rigid
    assert isinstance(explainer.recognizer, UninformedRecognizer)
    assert [path.name for path in cache.iterdir()] == [pack.name], "nothing half-made is left"
    monkeypatch.setattr(single, "build_class", None)
    assert pack_of_mesh(file) == pack, "not built again"
    assert not explainer.object_class.size_known, "a .ply has no unit"


@pytest.mark.parametrize(
    "name, content, message",
    [
        ("none.glb", None, "no such file"),
        ("notes.txt", b"notes", "notes.txt"),
        ("empty.obj", b"# nothing\n", "triangles"),
        ("flat.off", b"OFF\n3 1 0\n0 0 0\n0 0 0\n0 0 0\n3 0 1 2\n", "extent"),
    ],
)
def test_what_is_no_mesh_is_refused(
    cache: Path, tmp_path: Path, name: str, content: bytes | None, message: str
) -> None:
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(UserError, match=message):
        pack_of_mesh(tmp_path / name)
    assert not cache.exists() or not any(cache.iterdir())


@pytest.mark.slow
def test_a_length_that_is_told_is_the_size(cache: Path, tmp_path: Path) -> None:
    finned(1.0, 1.5, 0.45).export(tmp_path / "thing.ply")
    told: list[str] = []
    object_class = ObjectClass.load(pack_of_mesh(tmp_path / "thing.ply", 0.4, told.append))
    assert object_class.size_known
    assert "made ready" in told[0] and len(told) > 5 and all(line.endswith(" ...") for line in told[1:])
    assert np.ptp(object_class.shape_model.mean, axis=0).max() == pytest.approx(0.4)
    with pytest.raises(UserError, match="expected --length with --mesh"):
        classes_of(FitCommand((tmp_path / "photo.jpg",), length=0.4))


def test_a_mesh_goes_in_place_of_a_class(tmp_path: Path) -> None:
    given = FitCommand((tmp_path / "photo.jpg",), mesh=tmp_path / "cup.glb", object_class="mug")
    with pytest.raises(UserError, match="--mesh, --class or --objects"):
        classes_of(given)
