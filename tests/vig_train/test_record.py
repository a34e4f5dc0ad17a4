"""run.json: begun once, gone on with under the same settings only."""

import json
from pathlib import Path

import pytest

from vig.io.errors import UserError
from vig_paper.settings import ReproductionSettings
from vig_train.record import Record, read_record


def opened(folder: Path, **chosen) -> Record:
    return Record.open(
        folder / "run.json", ReproductionSettings.of("tiny", **chosen), {"cpus": 2}, "vig reproduce"
    )


def test_settings_and_machine_are_recorded(tmp_path: Path) -> None:
    opened(tmp_path / "r", epochs=3, methods=("rm", "robust"))
    data = json.loads((tmp_path / "r" / "run.json").read_text())
    assert data["settings"]["epochs"] == 3 and data["settings"]["methods"] == ["rm", "robust"]
    assert data["settings"]["weights"] is None and data["settings"]["scale"] == "tiny"
    assert data["machine"] == {"cpus": 2} and data["command"] == "vig reproduce" and data["vig"]


def test_a_run_of_the_same_settings_goes_on(tmp_path: Path) -> None:
    with opened(tmp_path / "r", seed=4).time_step("train"):
        pass
    record = opened(tmp_path / "r", seed=4)
    assert record.complete("train") and not record.complete("page")
    assert record.data["steps"]["train"]["finished"].endswith("+00:00")


@pytest.mark.parametrize(
    ("other", "said"),
    [
        ({"epochs": 5}, "a run with epochs 2; 5 was asked for"),
        ({"methods": ("rm",)}, "with methods baseline rm gaussian robust spatial; rm was asked for"),
        ({"weights": Path("w")}, "with weights none; w was asked for"),
    ],
)
def test_other_settings_are_refused_by_the_first_that_differs(tmp_path: Path, other, said: str) -> None:
    before = opened(tmp_path / "r").path.read_bytes()
    with pytest.raises(UserError, match=said):
        opened(tmp_path / "r", **other)
    assert (tmp_path / "r" / "run.json").read_bytes() == before


def test_an_unfinished_step_keeps_its_time(tmp_path: Path) -> None:
    record = opened(tmp_path / "r")
    record.data["steps"]["train"] = {"complete": False, "seconds": 100.0, "sittings": 1, "finished": None}
    with pytest.raises(ZeroDivisionError), record.time_step("train"):
        _ = 1 / 0
    record = opened(tmp_path / "r")
    assert not record.complete("train") and record.seconds("train") >= 100
    assert record.data["steps"]["train"]["sittings"] == 2


def test_a_folder_of_other_things_is_refused(tmp_path: Path) -> None:
    (tmp_path / "mine.txt").touch()
    with pytest.raises(UserError, match="holds other files"):
        opened(tmp_path)
    with pytest.raises(UserError, match="is a file"):
        opened(tmp_path / "mine.txt")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["mine.txt"]


@pytest.mark.parametrize("content", ["", "{", "[]", "{}", '{"vig_run": 1}', '{"vig_run": 99}'])
def test_a_damaged_record_is_told(tmp_path: Path, content: str) -> None:
    path = tmp_path / "run.json"
    path.write_text(content)
    for read in (lambda: read_record(path), lambda: opened(tmp_path)):
        with pytest.raises(UserError, match=r"run\.json"):
            read()
    assert path.read_text() == content
