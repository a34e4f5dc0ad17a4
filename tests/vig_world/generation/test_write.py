import shutil
import zipfile
from pathlib import Path

import pytest
import trimesh

from tests.support import contents, differing
from vig.io.errors import UserError
from vig.scene import ObjectClass
from vig_world.dataset.format import read_info
from vig_world.generation.files import sidecar_path
from vig_world.generation.job import Failure, Maker
from vig_world.generation.write import alone, make_dataset
from vig_world.library import OwnAssets, OwnFolders

COUNT, SEED = 10, 5  # of the fixture `made`


def test_the_bytes_do_not_depend_on_the_number_of_workers(
    made: Path, tmp_path: Path, teapot: ObjectClass
) -> None:
    other = make_dataset(tmp_path / "two", COUNT, SEED, workers=2, progress=False, object_class=teapot)
    assert not differing(contents(other), contents(made))


def test_a_killed_run_is_completed_with_the_same_bytes(
    made: Path, tmp_path: Path, teapot: ObjectClass, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole, calls = Maker.make, []

    def killed_at_the_fourth(maker: Maker, index: int, draw: int) -> dict[str, bytes] | Failure:
        calls.append(index)
        if len(calls) == 4:
            raise KeyboardInterrupt
        return whole(maker, index, draw)

    out = tmp_path / "killed"
    monkeypatch.setattr(Maker, "make", killed_at_the_fourth)
    with pytest.raises(KeyboardInterrupt):
        make_dataset(out, COUNT, SEED, workers=1, progress=False, object_class=teapot)
    assert [sidecar_path(out / "train", i).is_file() for i in range(5)] == [True, True, True, False, False]
    half_written = out / "train" / "000000" / "rgb" / ".0123456789ab.png"
    half_written.write_bytes(b"half")
    make_dataset(out, COUNT, SEED, workers=1, progress=False, object_class=teapot)
    assert calls[4:] == list(range(3, COUNT))
    assert not differing(contents(out), contents(made))


def test_a_complete_dataset_is_left_as_it_is(
    made: Path, teapot: ObjectClass, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delattr(Maker, "make")
    before = contents(made)
    make_dataset(made, COUNT, SEED, progress=False, object_class=teapot)
    assert not differing(contents(made), before)


@pytest.mark.parametrize(
    ("settings", "expected"),
    [
        ({"count": 0}, "count must be at least 1; got 0"),
        ({"seed": -1}, "seed must be"),
        ({"split": "dev"}, "split must be one of train, test, validation; got 'dev'"),
        ({"tier": "oil"}, "tier must be one of raster, cycles; got 'oil'"),
        ({"workers": 0}, "workers must be at least 1"),
    ],
)
def test_wrong_arguments_are_refused_before_anything_is_written(
    settings: dict[str, object], expected: str, tmp_path: Path, teapot: ObjectClass
) -> None:
    arguments: dict[str, object] = {
        "count": 1,
        "seed": 0,
        "object_class": teapot,
        "progress": False,
        **settings,
    }
    with pytest.raises(UserError, match=expected):
        make_dataset(tmp_path / "out", **arguments)  # type: ignore[arg-type]
    assert not (tmp_path / "out").exists()


def test_a_folder_of_something_else_is_refused(tmp_path: Path, teapot: ObjectClass) -> None:
    (tmp_path / "thesis.txt").write_text("mine")
    with pytest.raises(UserError, match=r"expected a dataset folder with info\.json"):
        make_dataset(tmp_path, 1, 0, object_class=teapot, progress=False)
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.txt"]


@pytest.mark.parametrize(("settings", "word"), [((COUNT, SEED + 1), "seed"), ((COUNT + 1, SEED), "count")])
def test_a_dataset_of_other_settings_is_refused(
    settings: tuple[int, int], word: str, made: Path, tmp_path: Path, teapot: ObjectClass
) -> None:
    copy = shutil.copytree(made, tmp_path / "copy")
    with pytest.raises(UserError, match=f"already holds a train split with {word}"):
        make_dataset(copy, *settings, object_class=teapot, progress=False)
    assert not differing(contents(copy), contents(made))


def test_a_run_that_made_nothing_claims_nothing(tmp_path: Path, monkeypatch) -> None:
    """As when Blender is missing: the folder may then be used for the other tier."""
    monkeypatch.setenv("VIG_BLENDER_PYTHON", str(tmp_path / "nowhere"))
    with pytest.raises(UserError, match="nowhere"):
        make_dataset(tmp_path / "d", 1, 0, tier="cycles", workers=1, progress=False)
    make_dataset(tmp_path / "d", 1, 0, workers=1, progress=False)
    assert read_info(tmp_path / "d")["splits"]["train"]["tier"] == "raster"


def test_two_runs_do_not_make_the_same_split(tmp_path: Path) -> None:
    """The second is told at once, and changes nothing; the lock is gone when the first has ended."""
    with alone(tmp_path, "train"):
        with pytest.raises(UserError, match="another run"):
            make_dataset(tmp_path, 1, 0, workers=1, progress=False)
        assert [path.name for path in tmp_path.iterdir()] == [".train.lock"]
    assert not list(tmp_path.iterdir())


def test_info_names_the_authors_of_a_catalogues_props(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    lines = ["license=CC-BY"]
    for number, (name, side) in enumerate((("Cube", "8"), ("Large cube", "800")), 1):
        fields = {"name": name, "model": "/cube.obj", "creator": "Ada", "width": side, "height": side}
        lines += [f"{key}#{number}={value}" for key, value in (fields | {"depth": side}).items()]
    with zipfile.ZipFile(tmp_path / "tiny.sh3f", "w") as archive:
        archive.writestr("cube.obj", trimesh.creation.box().export(file_type="obj"))
        archive.writestr("PluginFurnitureCatalog.properties", "\n".join(lines))
    source = str(tmp_path / "tiny.sh3f")
    own, notes = OwnAssets.read(OwnFolders(props=source))
    assert len(notes) == 1 and "large-cube.obj: expected a prop of 0.01 to 0.6 m" in notes[0]
    for _ in range(2):  # the second time it is found complete
        make_dataset(tmp_path / "d", 1, 0, workers=1, progress=False, own=own)
    info = read_info(tmp_path / "d")["splits"]["train"]
    assert set(info["own_assets"]) == {"prop/cube/cube.obj"}
    (cube,) = info["own_sources"]
    assert cube["file"] == "cube/cube.obj" and cube["catalogue"] == "tiny.sh3f"
    assert (cube["name"], cube["creator"], cube["licence"]) == ("Cube", "Ada", "CC-BY")
    with pytest.raises(UserError, match="already holds a train split with own_assets"):
        make_dataset(tmp_path / "d", 1, 0, workers=1, progress=False)
