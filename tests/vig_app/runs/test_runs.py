"""A run over photos: what is done stays, what is half done does not, the rest is said."""

import csv
import errno
import io
import json
import os
import pty
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import nullcontext, suppress
from io import StringIO
from pathlib import Path
from typing import Any

import pyarrow.parquet as parquet
import pytest
from PIL import Image

import vig
from tests.nodes import needs_ray, two_nodes
from tests.support import run_vig
from vig.io.errors import UserError
from vig_app.cli import fit as fit_verb
from vig_app.cli.photos import photos_of, result_folders
from vig_app.examples import example_photos
from vig_app.exports import export_run
from vig_app.results import COLUMNS, write_table
from vig_app.runs import PARTIAL, RunSettings, Task, run
from vig_app.runs.ledger import ledger_of, rows_done
from vig_app.runs.work import Rows, Work

PLACE = (10, 10, 130, 130)
"""The box of all the photos: a search takes ten times as long as a fit."""
BOX = ["--box", ",".join(map(str, PLACE))]
COMMAND = [sys.executable, "-m", "vig", "fit", *BOX]


@pytest.fixture
def photos(tmp_path: Path) -> Path:
    """A folder of eight photos."""
    folder = tmp_path / "photos"
    folder.mkdir()
    for number, example in enumerate(example_photos()):
        with Image.open(example.photo) as photo:
            photo.convert("RGB").save(folder / f"{number}.png")
    return folder


def keep(photos: Path, count: int) -> None:
    """Of the eight the first so many."""
    for number in range(count, 8):
        (photos / f"{number}.png").unlink()


def fitted(*arguments: object) -> int:
    return run_vig("fit", *BOX, *arguments)


def rows_of(out: Path) -> list[dict[str, str]]:
    with open(out / "results.csv", encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def without_time(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    return [{name: value for name, value in row.items() if name != "seconds"} for row in rows]


def test_a_photo_is_fitted_once_unless_it_or_what_is_said_changes(
    photos: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    keep(photos, 4)
    assert fitted(photos, "--out", out) == 0
    first = rows_of(out)
    assert capsys.readouterr().out.count("done before") == 0
    written_at = (out / "0" / "explanation.json").stat().st_mtime_ns
    (out / "1" / "explanation.json").unlink()  # a user threw the result away
    (photos / "2.png").write_bytes((photos / "3.png").read_bytes())
    assert fitted(photos, "--out", out) == 0
    assert capsys.readouterr().out.count("done before") == 2
    assert (out / "0" / "explanation.json").stat().st_mtime_ns == written_at
    again = rows_of(out)
    assert without_time(again[:2]) == without_time(first[:2]) and again[2] != first[2]
    assert fitted(photos, "--out", out, "--visible") == 0
    assert capsys.readouterr().out.count("done before") == 0


def test_a_run_that_is_killed_goes_on_with_the_same_rows(photos: Path, tmp_path: Path) -> None:
    quiet, out = tmp_path / "quiet", tmp_path / "out"
    keep(photos, 5)
    assert fitted(photos, "--out", quiet, "--quiet") == 0
    with subprocess.Popen(
        [*COMMAND, photos, "--out", out, "--workers", "2"], stdout=subprocess.PIPE, text=True
    ) as killed:
        assert killed.stdout is not None
        killed.stdout.readline()  # one is done
        killed.send_signal(signal.SIGKILL)
    with open(out / "results.jsonl", "a") as ledger:
        ledger.write('{"key": "half a li')
    (out / f".4{PARTIAL}").mkdir()
    done = len(list(out.glob("*/explanation.json")))
    assert 1 <= done < 5
    ended = subprocess.run([*COMMAND, photos, "--out", out, "--workers", "2"], capture_output=True, text=True)
    assert ended.returncode == 0 and 1 <= ended.stdout.count("done before") <= done
    assert without_time(rows_of(out)) == without_time(rows_of(quiet))
    assert sorted(path.name for path in out.iterdir()) == sorted(path.name for path in quiet.iterdir())


def test_two_runs_do_not_write_to_one_folder(photos: Path, tmp_path: Path) -> None:
    tasks = [Task(photos / "0.png", tmp_path / "out" / "0", PLACE)]
    first = run(tasks, tmp_path / "out", RunSettings())
    next(first)
    with pytest.raises(UserError, match="another run is writing to .*wait until it ends"):
        next(run(tasks, tmp_path / "out", RunSettings()))
    again = next(run(tasks, tmp_path / "out", RunSettings(), resume=False))  # as of a single photo
    assert "done_before" not in again
    first.close()
    assert next(run(tasks, tmp_path / "out", RunSettings()))["done_before"]


@pytest.mark.parametrize("interrupted", [False, True])
def test_the_table_is_written_before_another_run_may_begin(
    interrupted: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whatever ends the run: a table written later would lose what another process wrote meanwhile."""
    for name in "ab":
        (tmp_path / f"{name}.png").write_bytes(b"no picture")
    written: list[int] = []

    def write(out: Path, rows: list[dict[str, Any]]) -> list[Path]:
        with pytest.raises(UserError, match="another run is writing"), ledger_of(out):
            pass
        written.append(len(rows))
        return write_table(out, rows)

    def stopped(self: Work, task: Task) -> Rows:
        if task.photo.name == "b.png":
            raise KeyboardInterrupt
        return explained(self, task)

    explained = Work.__call__
    monkeypatch.setattr(fit_verb, "write_table", write)
    if interrupted:
        monkeypatch.setattr(Work, "__call__", stopped)
    code = fitted(tmp_path / "a.png", tmp_path / "b.png", "--out", tmp_path / "out")
    assert (code, written) == ((130, [1]) if interrupted else (2, [2]))
    with ledger_of(tmp_path / "out"):  # then the next one may
        pass


def test_a_disk_without_locks_is_told(photos: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(file: object, kind: int) -> None:
        raise OSError(errno.ENOLCK, os.strerror(errno.ENOLCK))

    monkeypatch.setattr("fcntl.flock", refuse)
    with pytest.raises(UserError, match="cannot lock .*results.jsonl: No locks available; choose an --out"):
        next(run([Task(photos / "0.png", tmp_path / "0", PLACE)], tmp_path, RunSettings()))


def test_a_full_disk_is_told_and_keeps_what_is_done(
    photos: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Full(io.StringIO):
        def write(self, text: str) -> int:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    out = tmp_path / "out"
    out.mkdir()
    monkeypatch.setattr("vig_app.runs.photos.ledger_of", lambda _: nullcontext(Full("\n")))
    with pytest.raises(UserError, match="cannot write .*results.jsonl: No space left.* same command"):
        list(run([Task(photos / "0.png", out / "0", PLACE)], out, RunSettings()))
    assert (out / "0" / "explanation.json").exists()


def test_a_bad_mask_is_its_photos_error(
    photos: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The others go on, and a mask that is put right is seen as a change."""
    masks, out = tmp_path / "masks", tmp_path / "out"
    masks.mkdir()
    for number in range(6):
        Image.new("L", (150, 150), 255).save(masks / f"{number}.png")
    Image.new("L", (20, 20), 255).save(masks / "1.png")
    (masks / "2.png").write_text("no picture")
    os.mkfifo(masks / "6.png")
    assert fitted(photos, "--out", out, "--mask", masks) == 1
    bad = {Path(row["photo"]).stem: row["error"] for row in rows_of(out) if row["error"]}
    assert list(bad) == ["1", "2", "6", "7"]
    assert all(error.startswith(f"{photos / name}.png: ") for name, error in bad.items())
    assert "expected mask of 150 x 150" in bad["1"] and "nothing of that name" in bad["7"]
    described = json.loads((out / "0" / "explanation.json").read_text())
    assert described["hints"] == {"mask": 150 * 150}
    Image.new("L", (150, 150), 255).save(masks / "1.png")
    os.utime(masks / "0.png", (0, 0))
    capsys.readouterr()
    assert fitted(photos, "--out", out, "--mask", masks) == 1
    assert capsys.readouterr().out.count("done before") == 3
    assert not rows_of(out)[1]["error"]


def test_tasks_are_taken_as_they_are_needed(photos: Path, tmp_path: Path) -> None:
    taken: list[int] = []

    def tasks() -> Iterator[Task]:
        for number in range(8):
            taken.append(number)
            yield Task(photos / f"{number}.png", tmp_path / "out" / str(number), PLACE)

    rows = run(tasks(), tmp_path / "out", RunSettings())
    next(rows)
    assert len(taken) == 2
    rows.close()


def test_a_photo_that_vanishes_during_a_run_is_its_own_error(photos: Path, tmp_path: Path) -> None:
    tasks = [Task(photos / f"{number}.png", tmp_path / "out" / str(number), PLACE) for number in range(3)]
    rows = run(tasks, tmp_path / "out", RunSettings())
    first = next(rows)
    (photos / "1.png").unlink()
    (photos / "2.png").unlink()
    (photos / "2.png").mkdir()
    gone, folder = rows
    assert first["error"] is None and "got nothing of that name" in gone["error"]
    assert "got a folder" in folder["error"]
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["0", "results.jsonl"]


@pytest.mark.parametrize(
    ("number", "reason"), [(errno.ENOSPC, "No space left on device"), (errno.EROFS, "Read-only file system")]
)
def test_a_folder_that_cannot_be_written_is_its_photos_error(
    number: int, reason: str, photos: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    rename, out = os.rename, tmp_path / "out"

    def refusing(source: str | Path, target: str | Path) -> None:
        if Path(target).name == "1":
            raise OSError(number, os.strerror(number))
        rename(source, target)

    monkeypatch.setattr("vig_app.runs.work.os.rename", refusing)
    rows = list(run([Task(photos / f"{name}.png", out / name, PLACE) for name in "012"], out, RunSettings()))
    assert [row["error"] is None for row in rows] == [True, False, True]
    assert reason in rows[1]["error"] and "choose another --out" in rows[1]["error"]
    assert sorted(path.name for path in out.iterdir()) == ["0", "2", "results.jsonl"]


def test_results_where_none_can_be_are_refused_at_once(
    photos: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "out").write_text("a file")
    assert fitted(photos, "--out", tmp_path / "out") == 2
    assert "cannot write" in capsys.readouterr().err


def test_ctrl_c_keeps_what_is_done_and_says_so(photos: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    with subprocess.Popen(
        [*COMMAND, photos, "--out", out], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as stopped:
        assert stopped.stdout is not None and stopped.stderr is not None
        stopped.stdout.readline()
        stopped.send_signal(signal.SIGINT)
        errors = stopped.stderr.read()
    assert stopped.returncode == 130 and errors.strip() == "vig: interrupted; what is finished stays"
    done = [row["folder"] for row in rows_of(out)]
    assert 1 <= len(done) < 8 and (out / "sheet.jpg").exists() and (out / "report.html").exists()
    assert sorted(path.parent.name for path in out.glob("*/explanation.json")) == sorted(done)


@pytest.mark.parametrize(("arguments", "shown"), [((), True), (("--quiet",), False)])
def test_a_terminal_shows_how_many_are_done_and_the_time_left(
    arguments: tuple[str, ...], shown: bool, photos: Path, tmp_path: Path
) -> None:
    """Standard error is a terminal, standard output none: lines of results stay whole there."""
    keep(photos, 3)
    terminal, ours = pty.openpty()
    # A rate takes a second, in which a fast machine has explained all of them.
    start = (
        "from vig.io import progress; progress.BETWEEN_MARKS = 0; from vig_app.cli.main import main; main()"
    )
    command = [sys.executable, "-c", start, *COMMAND[3:], photos, "--out", tmp_path / "out", *arguments]
    environment = os.environ | {"COLUMNS": "100", "TERM": "xterm"}
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=ours, text=True, env=environment) as run:
        os.close(ours)
        written = b""
        with suppress(OSError):  # the terminal closes
            while read := os.read(terminal, 4096):
                written += read
        assert run.stdout is not None
        lines = run.stdout.read().splitlines()
    os.close(terminal)
    assert run.returncode == 0 and lines[-1] == str(tmp_path / "out")
    assert len([line for line in lines if "azimuth" in line]) == (3 if shown else 0)
    assert shown or len(lines) == 1
    steps = [step in written for step in (b"0/3", b"1/3", b"2/3")]
    assert steps == [shown] * 3 and (b"left" in written) == shown


def test_a_pattern_that_no_shell_expanded_is_expanded(photos: Path, tmp_path: Path) -> None:
    (photos / "[1].png").write_bytes((photos / "1.png").read_bytes())
    (photos / "notes.txt").write_text("no photo")
    assert photos_of((photos / "[0-2].png",), tmp_path) == [photos / f"{number}.png" for number in range(3)]
    assert photos_of((photos / "[1].png",), tmp_path) == [photos / "[1].png"]  # a file of that name
    assert len(photos_of((tmp_path / "**" / "*.png",), tmp_path)) == 9
    assert photos_of((tmp_path / "ph*",), tmp_path) == photos_of((photos,), tmp_path)
    with pytest.raises(UserError, match=r"expected photos that match '.*\*\.jpg'; got none\. Check"):
        photos_of((photos / "*.jpg",), tmp_path)
    assert result_folders([Path("results.csv.png"), Path("a.png")], tmp_path) == [
        tmp_path / "results.csv-2", tmp_path / "a",
    ]  # fmt: skip


def test_a_single_photo_leaves_nothing_but_its_folder(photos: Path, tmp_path: Path) -> None:
    assert fitted(photos / "0.png", "--out", tmp_path / "out") == 0
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["0"]


def test_bad_files_of_all_kinds_are_rows_with_a_reason(photos: Path, tmp_path: Path, capsys) -> None:
    keep(photos, 3)
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
    assert len(rows) == 12
    bad = {Path(row["photo"]).name: row["error"] for row in rows if row["error"]}
    assert set(bad) == {
        "empty.png", "text.jpg", "half.png", "nowhere.png", "folder.png", "fifo.png", "tiny.png",
    }  # fmt: skip
    assert all(name in error and "\n" not in error for name, error in bad.items())
    *errors, last = capsys.readouterr().err.splitlines()
    assert [line[:5] for line in errors] == 7 * ["vig: "] and "explained 5 of 12 photos" in last
    table = parquet.read_table(tmp_path / "out" / "results.parquet")
    assert tuple(table.column_names) == tuple(COLUMNS) and table.num_rows == 12
    assert table.column("verdict").null_count == 7
    assert not list((tmp_path / "out").glob(f".*{PARTIAL}"))


def test_the_table_has_the_pose_and_types_whatever_is_in_it(photos: Path, tmp_path: Path) -> None:
    (row,) = run([Task(photos / "0.png", tmp_path / "out" / "0", PLACE)], tmp_path / "out", RunSettings())
    described = json.loads((tmp_path / "out" / "0" / "explanation.json").read_text())
    pose = [[row[f"camera_from_object_{i}{j}"] for j in range(4)] for i in range(3)]
    assert pose == described["pinhole"]["camera_from_object"][:3]
    assert (row["focal_px"], row["verdict"]) == (described["pinhole"]["K"][0][0], described["verdict"])
    assert tuple(row) == tuple(COLUMNS)
    full, empty = tmp_path / "full", tmp_path / "empty"
    for folder, rows in ((full, [row]), (empty, [])):
        folder.mkdir()
        assert [path.name for path in write_table(folder, rows)] == ["results.csv", "results.parquet"]
    schemas = [parquet.read_schema(folder / "results.parquet") for folder in (full, empty)]
    assert schemas[0].equals(schemas[1])


@pytest.mark.slow
def test_a_photo_that_kills_its_worker_is_named_and_the_others_go_on(
    photos: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Any worker that begins with photo 3 is killed by us."""
    monkeypatch.setattr("vig_app.runs.photos.prepare", deadly)
    tasks = [Task(photo, tmp_path / "out" / photo.stem, PLACE) for photo in sorted(photos.iterdir())[1:5]]
    rows = {Path(row["photo"]).name: row for row in run(tasks, tmp_path / "out", RunSettings(), workers=2)}
    assert len(rows) == 4
    assert "killed 3 times" in rows.pop("3.png")["error"]
    assert all(row["error"] is None for row in rows.values())


def deadly(settings: RunSettings) -> Any:
    work = Work(vig.Explainer(settings.object_class), settings)

    def kill_or_work(task: Task) -> Rows:
        if task.photo.name == "3.png":
            os.kill(os.getpid(), signal.SIGKILL)
            time.sleep(10)
        return work(task)

    return kill_or_work


@pytest.mark.slow
@needs_ray
def test_a_cluster_one_of_whose_nodes_is_killed_has_the_same_rows(photos: Path, tmp_path: Path) -> None:
    """Two nodes on this machine; one dies when two photos are there. A pipe among them is a row here, too.

    So are masks: one that is good, one of another size, one that is none, one that is missing.
    """
    os.mkfifo(photos / "8.png")
    (photos / "9.png").write_text("no photo")
    names = [f"{number}.png" for number in range(10)]
    out = tmp_path / "out"
    masks = {name: tmp_path / name for name in names[:4]}
    for name, size in zip(names[:2], (150, 20), strict=True):
        Image.new("L", (size, size), 255).save(masks[name])
    masks["2.png"].write_text("no mask")
    with two_nodes(lambda: len(list(out.glob("*/explanation.json"))), after=2) as (address, killed):
        tasks = [Task(photos / name, out / name, mask=masks.get(name)) for name in names]
        rows = list(run(tasks, out, RunSettings(export=("coco", "bop")), cluster=address))
    assert killed and killed[0] < 8
    here = tmp_path / "here"
    tasks = [Task(photos / name, here / name, mask=masks.get(name)) for name in names]
    expected = list(run(tasks, here, RunSettings(export=("coco", "bop"))))
    rows.sort(key=lambda row: names.index(row["folder"]))
    assert without_time(rows) == without_time(expected)
    assert [Path(row["photo"]).name for row in rows if row["error"]] == names[1:4] + names[8:]
    for name in names[:1] + names[4:8]:
        files = sorted(str(path.relative_to(here / name)) for path in (here / name).rglob("*"))
        assert sorted(str(path.relative_to(out / name)) for path in (out / name).rglob("*")) == files
        assert ("corrections.json" in files) == (name not in masks)
        for file in {"explanation.json", "corrections.json", "overlay.png", "coco.json"}.intersection(files):
            assert (out / name / file).read_bytes() == (here / name / file).read_bytes()


def test_where_there_is_no_cluster_it_is_told(photos: Path, tmp_path: Path) -> None:
    with pytest.raises(UserError, match=r"no Ray cluster answers at '127.0.0.1:1'|vig\[cluster\]"):
        task = Task(photos / "0.png", tmp_path / "o" / "0", PLACE)
        list(run([task], tmp_path / "o", RunSettings(), cluster="127.0.0.1:1"))


@pytest.mark.parametrize(
    "line", ['{"key": "a", "rows": []}', "[]", "3", '{"rows": [3]}', '{"key": 1, "ro', ""]
)
def test_a_damaged_line_of_the_ledger_is_passed_over(line: str) -> None:
    row = {"error": None, "folder": "photo/1-mug", "photo": "a.png", "verdict": "trusted", "roll_deg": 1.5}
    whole = json.dumps({"key": "b", "rows": [row]})
    line = line or json.dumps({"key": "b", "rows": [row | {"roll_deg": "1.5", "folder": "text"}]})
    assert list(rows_done(StringIO(f"{line}\n{whole}\n"))) == ["photo"]


def test_exports_of_earlier_results_go_when_a_photo_is_fitted_again(photos: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    assert fitted(photos / "0.png", photos / "1.png", "--out", out) == 0
    for name in ("bop.csv", "coco.json", "mine.csv"):
        (out / name).write_text("")
    assert fitted(photos / "0.png", photos / "1.png", "--out", out) == 0
    assert (out / "bop.csv").exists(), "nothing changed"
    assert fitted(photos / "0.png", photos / "1.png", "--elevation", 30, "--out", out) == 0
    assert not (out / "bop.csv").exists() and not (out / "coco.json").exists()
    assert (out / "mine.csv").exists()
    assert fitted(photos / "0.png", photos / "1.png", "--export", "bop", "ros", "--out", out) == 0
    written = (out / "bop.csv").read_text()
    assert len(written.splitlines()) == 3 and export_run(out, ["bop"])[0].read_text() == written
    assert (out / "1" / "pose.yaml").exists() and (out / "1" / "bop").is_dir()


@pytest.mark.parametrize("there", [False, True])
def test_what_is_refused_before_anything_is_done_leaves_no_folder(there: bool, tmp_path: Path) -> None:
    out = tmp_path / "out"
    if there:
        out.mkdir()
    with pytest.raises(UserError, match="no cluster"), ledger_of(out):
        raise UserError("no cluster")
    assert out.exists() == there
