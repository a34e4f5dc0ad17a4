"""A run over photos: what is done stays, what is half done does not, the rest is said."""

from __future__ import annotations

import csv
import errno
import io
import json
import os
import signal
import subprocess
import sys
import time
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import pyarrow.parquet as parquet
import pytest
from PIL import Image

import vig
from tests.nodes import needs_ray, two_nodes
from vig.cli.main import main
from vig.errors import UserError
from vig.runs import COLUMNS, PARTIAL, RunSettings, Task, run, write_table
from vig_lab.examples import example_photos

COMMAND = [sys.executable, "-m", "vig", "fit"]


@pytest.fixture
def photos(tmp_path: Path) -> Path:
    """A folder of eight photos."""
    folder = tmp_path / "photos"
    folder.mkdir()
    for number, example in enumerate(example_photos()):
        with Image.open(example.photo) as photo:
            photo.convert("RGB").save(folder / f"{number}.png")
    return folder


def fitted(*arguments: object) -> int:
    with pytest.raises(SystemExit) as ended:
        main(["fit", *map(str, arguments)])
    return int(ended.value.code or 0)


def rows_of(out: Path) -> list[dict[str, str]]:
    with open(out / "results.csv", encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def without_time(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    return [{name: value for name, value in row.items() if name != "seconds"} for row in rows]


def test_a_photo_is_fitted_once_unless_it_or_what_is_said_changes(
    photos: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    assert fitted(photos, "--out", out) == 0
    first = rows_of(out)
    assert capsys.readouterr().out.count("done before") == 0
    kept = (out / "3" / "explanation.json").stat().st_mtime_ns
    (out / "5" / "explanation.json").unlink()  # a user threw the result away
    (photos / "6.png").write_bytes((photos / "7.png").read_bytes())
    assert fitted(photos, "--out", out) == 0
    assert capsys.readouterr().out.count("done before") == 6
    assert (out / "3" / "explanation.json").stat().st_mtime_ns == kept
    again = rows_of(out)
    assert without_time(again[:6]) == without_time(first[:6]) and again[6] != first[6]
    assert fitted(photos, "--out", out, "--visible") == 0
    assert capsys.readouterr().out.count("done before") == 0


def test_a_run_that_is_killed_goes_on_with_the_same_rows(photos: Path, tmp_path: Path) -> None:
    quiet, out = tmp_path / "quiet", tmp_path / "out"
    assert fitted(photos, "--out", quiet, "--quiet") == 0
    with subprocess.Popen(
        [*COMMAND, photos, "--out", out, "--workers", "2"], stdout=subprocess.PIPE, text=True
    ) as killed:
        assert killed.stdout is not None
        killed.stdout.readline()  # one is done
        killed.send_signal(signal.SIGKILL)
    with open(out / "results.jsonl", "a") as ledger:
        ledger.write('{"key": "half a li')
    (out / f".7{PARTIAL}").mkdir()
    done = len(list(out.glob("*/explanation.json")))
    assert 1 <= done < 8
    ended = subprocess.run([*COMMAND, photos, "--out", out, "--workers", "2"], capture_output=True, text=True)
    assert ended.returncode == 0 and 1 <= ended.stdout.count("done before") <= done
    assert without_time(rows_of(out)) == without_time(rows_of(quiet))
    assert sorted(path.name for path in out.iterdir()) == sorted(path.name for path in quiet.iterdir())


def test_two_runs_do_not_write_to_one_folder(photos: Path, tmp_path: Path) -> None:
    tasks = [Task(photos / "0.png", tmp_path / "out" / "0")]
    first = run(tasks, tmp_path / "out", RunSettings())
    next(first)
    with pytest.raises(UserError, match="another run is writing to .*wait until it ends"):
        next(run(tasks, tmp_path / "out", RunSettings()))
    again = next(run(tasks, tmp_path / "out", RunSettings(), resume=False))  # as of a single photo
    assert "done_before" not in again
    first.close()
    assert next(run(tasks, tmp_path / "out", RunSettings()))["done_before"]


def test_a_full_disk_is_told_and_keeps_what_is_done(
    photos: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Full(io.StringIO):
        def write(self, text: str) -> int:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    out = tmp_path / "out"
    out.mkdir()
    monkeypatch.setattr("vig.runs._ledger", lambda _: nullcontext(Full("\n")))
    with pytest.raises(UserError, match="cannot write .*results.jsonl: No space left.* same command"):
        list(run([Task(photos / "0.png", out / "0")], out, RunSettings()))
    assert (out / "0" / "explanation.json").exists()


def test_a_single_photo_leaves_nothing_but_its_folder(photos: Path, tmp_path: Path) -> None:
    assert fitted(photos / "0.png", "--out", tmp_path / "out") == 0
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["0"]


def test_bad_files_of_all_kinds_are_rows_with_a_reason(
    photos: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (photos / "empty.png").touch()
    (photos / "text.jpg").write_text("no photo")
    (photos / "half.png").write_bytes((photos / "0.png").read_bytes()[:3000])
    (photos / "nowhere.png").symlink_to(photos / "gone.png")
    (photos / "folder.png").mkdir()
    os.mkfifo(photos / "fifo.png")
    (photos / "new\nline.png").write_bytes((photos / "1.png").read_bytes())
    os.link(photos / "1.png", os.fsencode(photos) + b"/\xff.png")
    Image.new("RGB", (4, 4)).save(photos / "tiny.png")
    assert fitted(photos, "--out", tmp_path / "out", "--workers", "2") == 1
    rows = rows_of(tmp_path / "out")
    assert len(rows) == 17
    bad = {Path(row["photo"]).name: row["error"] for row in rows if row["error"]}
    assert set(bad) == {
        "empty.png", "text.jpg", "half.png", "nowhere.png", "folder.png", "fifo.png", "tiny.png",
    }  # fmt: skip
    assert all(name in error and "\n" not in error for name, error in bad.items())
    errors = capsys.readouterr().err
    assert errors.count("vig: ") == 7 and "Traceback" not in errors
    table = parquet.read_table(tmp_path / "out" / "results.parquet")
    assert tuple(table.column_names) == COLUMNS and table.num_rows == 17
    assert table.column("verdict").null_count == 7
    assert not list((tmp_path / "out").glob(f".*{PARTIAL}"))


def test_the_table_has_the_pose_and_types_whatever_is_in_it(photos: Path, tmp_path: Path) -> None:
    (row,) = run([Task(photos / "0.png", tmp_path / "out" / "0")], tmp_path / "out", RunSettings())
    said = json.loads((tmp_path / "out" / "0" / "explanation.json").read_text())
    pose = [[row[f"camera_from_object_{i}{j}"] for j in range(4)] for i in range(3)]
    assert pose == said["camera"]["camera_from_object"][:3]
    assert (row["focal_px"], row["verdict"]) == (said["camera"]["K"][0][0], said["verdict"])
    assert tuple(row) == COLUMNS
    one, none = tmp_path / "one", tmp_path / "none"
    for folder, rows in ((one, [row]), (none, [])):
        folder.mkdir()
        assert [path.name for path in write_table(folder, rows)] == ["results.csv", "results.parquet"]
    schemas = [parquet.read_schema(folder / "results.parquet") for folder in (one, none)]
    assert schemas[0].equals(schemas[1])


@pytest.mark.slow
def test_a_photo_that_kills_its_worker_is_named_and_the_others_go_on(
    photos: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Any worker that begins with photo 3 is killed by us."""
    monkeypatch.setattr("vig.runs._prepare", deadly)
    tasks = [Task(photo, tmp_path / "out" / photo.stem) for photo in sorted(photos.iterdir())]
    rows = {Path(row["photo"]).name: row for row in run(tasks, tmp_path / "out", RunSettings(), workers=2)}
    assert len(rows) == 8
    assert "killed 3 times" in rows.pop("3.png")["error"]
    assert all(row["error"] is None for row in rows.values())


def deadly(settings: RunSettings) -> Any:
    work = vig.runs._Work(vig.Explainer(settings.object_class), ())

    def kill_or_work(task: Task) -> dict[str, Any]:
        if task.photo.name == "3.png":
            os.kill(os.getpid(), signal.SIGKILL)
            time.sleep(10)
        return work(task)

    return kill_or_work


@pytest.mark.slow
@needs_ray
def test_a_cluster_one_of_whose_nodes_is_killed_has_the_same_rows(photos: Path, tmp_path: Path) -> None:
    """Two nodes on this machine; one dies when two photos are there. A pipe among them is a row here, too."""
    os.mkfifo(photos / "8.png")
    (photos / "9.png").write_text("no photo")
    names = [f"{number}.png" for number in range(10)]
    out = tmp_path / "out"
    with two_nodes(lambda: len(list(out.glob("*/explanation.json"))), after=2) as (address, killed):
        tasks = [Task(photos / name, out / name) for name in names]
        rows = list(run(tasks, out, RunSettings(export=("coco", "bop")), cluster=address))
    assert killed and killed[0] < 8
    here = tmp_path / "here"
    tasks = [Task(photos / name, here / name) for name in names]
    expected = list(run(tasks, here, RunSettings(export=("coco", "bop"))))
    rows.sort(key=lambda row: names.index(row["folder"]))
    assert without_time(rows) == without_time(expected)
    assert [Path(row["photo"]).name for row in rows if row["error"]] == ["8.png", "9.png"]
    for name in names[:8]:
        files = sorted(str(path.relative_to(here / name)) for path in (here / name).rglob("*"))
        assert sorted(str(path.relative_to(out / name)) for path in (out / name).rglob("*")) == files
        for file in ("explanation.json", "corrections.json", "overlay.png", "coco.json"):
            assert (out / name / file).read_bytes() == (here / name / file).read_bytes()


def test_where_there_is_no_cluster_it_is_told(photos: Path, tmp_path: Path) -> None:
    with pytest.raises(UserError, match=r"no Ray cluster answers at '127.0.0.1:1'|vig\[cluster\]"):
        list(
            run(
                [Task(photos / "0.png", tmp_path / "o" / "0")],
                tmp_path / "o",
                RunSettings(),
                cluster="127.0.0.1:1",
            )
        )
