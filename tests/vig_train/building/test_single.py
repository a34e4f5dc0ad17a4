"""A class of one mesh file, as `vig fit --mesh` makes it."""

import errno
import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh

from tests.toys import toy
from tests.vig_train.building.things import finned
from vig.io.errors import UserError
from vig.io.files import atomic_write
from vig.recognition import UninformedRecognizer
from vig.scene import ObjectClass
from vig_app.cli.boxes import classes_of
from vig_app.cli.options import PlaceOptions
from vig_train.building import BuildSettings, build_class, single
from vig_train.building.pose import up_axis
from vig_train.building.reading import Scan
from vig_train.building.settings import USUAL_LENGTH
from vig_train.building.single import pack_of_mesh
from vig_train.building.surface import SurfaceSample
from vig_world.asset_cache import AssetCache


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(single, "asset_cache", lambda: AssetCache(tmp_path / "cache"))
    return tmp_path / "cache" / "meshes"


@pytest.mark.slow
def test_a_mesh_becomes_a_pack_once(cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from vig import Explainer

    file, told = tmp_path / ".thing.ply", list[str]()
    finned(1.0, 1.5, 0.45).convex_hull.export(file)
    pack = pack_of_mesh(file, 0.4, told.append, "-x")
    explainer = Explainer(pack)
    object_class = explainer.object_class
    assert object_class.name == ".thing" and object_class.shape_model.rigid
    assert isinstance(explainer.recognizer, UninformedRecognizer)
    assert [path.name for path in cache.iterdir()] == [pack.name], "nothing half-made is left"
    assert object_class.size_known and object_class.up_known
    assert object_class.object_from_mesh is not None
    # The scale is 0.4 m over the height of 1.5, and the stated axis is not levelled to a foot.
    np.testing.assert_allclose(object_class.object_from_mesh[2, :3], [-0.4 / 1.5, 0, 0], rtol=0.02, atol=1e-9)
    assert np.ptp(object_class.shape_model.mean, axis=0).max() == pytest.approx(0.4)
    assert "made ready" in told[0] and "longest side is 0.4 m" in told[1] and len(told) == 2
    monkeypatch.setattr(single, "build_class", None)
    assert pack_of_mesh(file, 0.4, up="-X") == pack, "not built again"


@pytest.mark.parametrize(
    "name, content, message",
    [
        ("none.glb", None, "no such file"),
        ("notes.txt", b"notes", "notes.txt"),
        ("empty.obj", b"# nothing\n", "triangles"),
        ("flat.off", b"OFF\n3 1 0\n0 0 0\n0 0 0\n0 0 0\n3 0 1 2\n", "extent"),
        ("line.off", b"OFF\n3 1 0\n0 0 0\n1 0 1e-7\n2 0 0\n3 0 1 2\n", "line"),
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


def test_a_mesh_goes_in_place_of_a_class(tmp_path: Path) -> None:
    given = PlaceOptions(mesh=tmp_path / "cup.glb", object_class="mug")
    with pytest.raises(UserError, match="--mesh, --class or --objects"):
        classes_of(given, print)
    for option in ({"length": 0.4}, {"up": "z"}):
        with pytest.raises(UserError, match=f"expected --{next(iter(option))} with --mesh"):
            classes_of(PlaceOptions(**option), print)  # type: ignore[arg-type]


def fake_build(mesh: Path, out: Path, settings: BuildSettings, say: Callable[[str], None]) -> None:
    """In place of `build_class`: a box whose file has millimetres and +Y up."""
    moved = np.eye(4)
    moved[:3, :3] = 0.001 * np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
    replace(toy("fin"), name=settings.name, object_from_mesh=moved, size_known=False).save(out)


def full_disk(mesh: Path, out: Path, settings: BuildSettings, say: Callable[[str], None]) -> None:
    if "scratch" not in str(out):
        with atomic_write(out / "class.json"):
            raise OSError(errno.ENOSPC, "No space left on device")
    fake_build(mesh, out, settings, say)


@pytest.mark.parametrize("state", ["full", "file in the way", "none"])
def test_a_cache_that_cannot_be_used_is_done_without(
    cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, state: str
) -> None:
    finned(1.0, 1.5, 0.45).export(tmp_path / "a\nb.ply")
    monkeypatch.setattr(single, "build_class", full_disk)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "scratch"))
    (tmp_path / "scratch").mkdir()
    if state == "file in the way":
        cache.parent.write_text("")
    if state == "none":
        monkeypatch.setattr(single, "asset_cache", lambda: AssetCache(None))
    told: list[str] = []
    pack = pack_of_mesh(tmp_path / "a\nb.ply", say=told.append)
    assert pack.is_relative_to(tmp_path / "scratch") and ObjectClass.load(pack).name == "a_b"
    assert sum("cache cannot be used" in line for line in told) == 1
    assert state != "full" or not list(cache.iterdir()), "nothing half-made is left"


def test_what_is_assumed_of_a_file_is_said(
    cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(single, "build_class", fake_build)
    mesh = finned(1.0, 2.0, 0.45)
    mesh.visual.vertex_colors = np.tile([[255, 0, 0, 255], [0, 0, 255, 255]], (len(mesh.vertices) // 2, 1))
    mesh.export(tmp_path / "thing.glb")
    for length, words in (
        (None, "longest side of 2 m is doubtful"),
        (0.01, "is 0.01 m as --length states, in place of the file's 2 m"),
    ):
        told: list[str] = []
        pack_of_mesh(tmp_path / "thing.glb", length, told.append)
        assert words in told[-2] and "+y axis is taken as up; --up" in told[-1]


@pytest.mark.parametrize(
    "own, known", [(0.113, True), (1.0, False), (0.99, False), (2.0, False), (2e3, False)]
)
def test_a_gltf_of_a_unit_cube_has_no_known_size(own: float, known: bool) -> None:
    scan = Scan("mug.glb", own * np.eye(3), np.array([[0, 1, 2]]), "")
    length, is_known = BuildSettings("mug").length_of([scan])
    assert is_known is known and length == (own if own < 1000 else USUAL_LENGTH)
    assert BuildSettings("mug", length=0.1).length_of([scan]) == (0.1, True)


def test_up_is_where_a_mesh_stands_broad_and_does_not_tip() -> None:
    plate = trimesh.creation.box((0.15, 0.08, 0.002))
    cone = trimesh.creation.cone(0.03, 0.1)
    for mesh, up in ((plate, 2), (cone, 2)):
        for turn in range(3):  # the axes x y z become y z x
            points = np.roll(mesh.sample(4000, seed=0), turn, axis=1)
            surface = SurfaceSample(points, np.zeros_like(points))
            np.testing.assert_array_equal(up_axis([surface], [np.eye(3)]), np.roll(np.eye(3)[up], turn))


@pytest.mark.slow
def test_an_open_rectangle_becomes_a_class(tmp_path: Path) -> None:
    (tmp_path / "poster.obj").write_text("v -1 0 0\nv 1 0 0\nv 1 0 1.5\nv -1 0 1.5\nf 1 2 3\nf 1 3 4\n")
    settings = BuildSettings("poster", length=0.2, vertices=300, materials=False)
    made = build_class(tmp_path / "poster.obj", tmp_path / "pack", settings, lambda line: None).object_class
    sides = np.sort(np.ptp(made.shape_model.mean, axis=0))
    np.testing.assert_allclose(sides, [0, 0.15, 0.2], atol=0.01)
