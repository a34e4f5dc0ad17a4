"""A run over photos: a folder of results for each, a ledger to resume from, one table.

What is done stays, whatever ends the run: a photo's folder appears when it is complete, and its row in
`results.jsonl` after that. A photo whose row is there is not fitted again while photo, settings and class are
the same.
"""

from __future__ import annotations

import csv
import hashlib
import json
import math
import os
import shutil
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from vig import __version__
from vig.corrections import CORRECTIONS, State
from vig.errors import UserError
from vig.explainer import Box, Explainer
from vig.explanation import Explanation
from vig.files import atomic_write
from vig.hints import Hints
from vig.inference import ExplainSettings
from vig.parallel import Lost, map_as_done
from vig.parallel.cluster import map_on_cluster
from vig.photo.images import existing_file
from vig.tracking import Track, TrackedFrame, track

LEDGER, TABLE, TRACK = "results.jsonl", "results", "track"
PARTIAL = ".partial"
FORMAT = 1
COLUMNS = (
    "photo", "folder", "error", "verdict", "view_trusted", "mask_trusted", "confidence", "mask_confidence",
    "azimuth_deg", "elevation_deg", "roll_deg", "azimuth_deviation_deg", "elevation_deviation_deg",
    "hidden_fraction", "family", "albedo_r", "albedo_g", "albedo_b", "box_x", "box_y", "box_width",
    "box_height", "width", "height", "focal_px", "center_x", "center_y", "focal_from",
    *(POSE := [f"camera_from_object_{row}{column}" for row in range(3) for column in range(4)]), "reason",
    "seconds",
)  # fmt: skip
"""Of the table; docs/many.md describes them."""
TRACK_COLUMNS = (
    "photo", "folder", "frame", "lost", "refitted", "alone_azimuth_deg", "azimuth_deg",
    "azimuth_deviation_deg", "alone_elevation_deg", "elevation_deg", "elevation_deviation_deg", "roll_deg",
    "hidden_fraction", "focal_px", "center_x", "center_y", *POSE,
)  # fmt: skip
"""Of the table of a track, likewise."""


@dataclass(frozen=True)
class Task:
    """One photo, the folder of its results, and what is said of it."""

    photo: Path
    folder: Path
    box: Box | None = None
    focal: float | None = None
    hints: Hints | None = None


@dataclass(frozen=True)
class RunSettings:
    """What a run does with each photo.

    Attributes:
        object_class: A packaged class or the folder of a pack.
        explain: How to fit.
        device: See `Explainer`.
        export: Formats that are written, too; see `Explanation.export`.
    """

    object_class: str | Path = "teapot"
    explain: ExplainSettings = ExplainSettings()
    device: str = "cpu"
    export: tuple[str, ...] = ()


def run(
    tasks: Iterable[Task],
    out: Path,
    settings: RunSettings,
    workers: int = 1,
    resume: bool = True,
    cluster: str | None = None,
) -> Iterator[dict[str, Any]]:
    """Explain photos into their folders, and yield the row of each as it is done, `COLUMNS`.

    Args:
        tasks: Any number, with folders within `out`.
        out: Holds the ledger.
        settings: For all photos.
        workers: Processes; with 1 it is done in this one, in order. One that is killed is replaced.
        resume: Keep a ledger, which no other run may be writing to. Photos that it has are not fitted again;
            their rows come first, with "done_before".
        cluster: Address of a Ray cluster in place of workers, `auto` for the one of this machine. Photos are
            sent to its nodes and results come back: they need vig and the class, but no shared disk.

    Raises:
        UserError: The class cannot be loaded, `out` cannot be written, another run writes there, or there is
            no such cluster.
    """
    explainer = Explainer(settings.object_class, settings.explain, settings.device)
    if not resume:
        yield from (row for _, row in _rows(list(tasks), settings, explainer, workers, cluster))
        return
    with _ledger(out) as ledger:
        done = _done(ledger)
        keys: dict[int, str] = {}
        waiting: list[Task] = []
        said = _described(settings, explainer)
        for task in tasks:
            key = _key(task, said)
            row = done.get(key)
            if row is not None and (out / row["folder"] / "explanation.json").exists():
                yield row | {"done_before": True}
            else:
                keys[len(waiting)] = key
                waiting.append(task)
        for number, row in _rows(waiting, settings, explainer, workers, cluster):
            try:
                ledger.write(json.dumps({"key": keys[number], "row": row}) + "\n")
                ledger.flush()
            except OSError as error:
                raise UserError(
                    f"cannot write {out / LEDGER}: {error.strerror}; what is done stays. Make room and run"
                    " the same command again."
                ) from error
            yield row


def run_tracked(
    tasks: list[Task], out: Path, settings: RunSettings, done: Callable[[dict[str, Any]], None]
) -> Track:
    """Explain the frames of a video together into their folders, and write track.csv, .parquet and .json.

    It is done in this process, from the first frame on each time.

    Args:
        tasks: In the frames' order; the box is that of the first.
        out: As in `run`.
        settings: For all frames.
        done: Is called with the row of a frame as it is done, once more where it is fitted again.

    Raises:
        UserError: As `vig.track`, or `out` cannot be written, or another run writes there.
    """
    explainer = Explainer(settings.object_class, settings.explain, settings.device)
    work, began = _Work(explainer, settings.export), [time.monotonic()]

    def seen(number: int, found: Explanation) -> None:
        work.write(tasks[number], found)
        now = time.monotonic()
        done(row_of(tasks[number], found) | {"seconds": round(now - began[0], 3)})
        began[0] = now

    with _ledger(out):
        first = tasks[0]
        photos = [task.photo for task in tasks]
        found = track(photos, explainer, first.box, first.focal, first.hints, seen)
        rows = [_row_of_track(task, frame) for task, frame in zip(tasks, found.frames, strict=True)]
        write_table(out, rows, TRACK, TRACK_COLUMNS)
        told = {"class": explainer.object_class.name, "shape": found.shape.tolist()}
        with atomic_write(out / f"{TRACK}.json") as temporary:
            temporary.write_text(json.dumps(told | {"albedo": found.albedo.tolist()}, indent=2) + "\n")
    return found


def _row_of_track(task: Task, frame: TrackedFrame) -> dict[str, Any]:
    camera, pose = frame.camera, frame.camera_from_object[:3].ravel().tolist()
    return {
        "photo": str(task.photo),
        "folder": task.folder.name,
        "frame": frame.number,
        "roll_deg": math.degrees(camera.roll),
        "focal_px": camera.focal,
        "center_x": camera.cx,
        "center_y": camera.cy,
        **{name: value for name, value in vars(frame).items() if name in TRACK_COLUMNS},
        **dict(zip(POSE, pose, strict=True)),
    }


def _rows(
    tasks: list[Task], settings: RunSettings, explainer: Explainer, workers: int, cluster: str | None
) -> Iterator[tuple[int, dict[str, Any]]]:
    if cluster is not None:
        yield from _rows_of_cluster(tasks, settings, cluster)
        return
    if workers == 1 or len(tasks) < 2:
        yield from enumerate(map(_Work(explainer, settings.export), tasks))
        return
    for number, row in map_as_done(_prepare, settings, tasks, min(workers, len(tasks))):
        yield number, _lost(tasks[number], row) if isinstance(row, Lost) else row


def _lost(task: Task, lost: Lost) -> dict[str, Any]:
    return _failed(
        task,
        f"{task.photo}: a worker process was killed {lost.attempts} times while it explained this photo,"
        " possibly out of memory; try it alone.",
    )


def _rows_of_cluster(
    tasks: list[Task], settings: RunSettings, address: str
) -> Iterator[tuple[int, dict[str, Any]]]:
    """As `_rows`; photos go as bytes, and files come back as bytes and are written here."""
    unread: list[tuple[int, dict[str, Any]]] = []
    sent: list[int] = []

    def items() -> Iterator[tuple[Task, bytes]]:
        for number, task in enumerate(tasks):
            try:
                data = existing_file(task.photo).read_bytes()
            except (UserError, OSError) as error:
                unread.append((number, _failed(task, str(error))))
                continue
            sent.append(number)
            yield task, data

    for place, found in map_on_cluster(_prepare_remote, settings, items(), address):
        number = sent[place]
        if isinstance(found, Lost):
            yield number, _lost(tasks[number], found)
            continue
        row, files = found
        try:
            if row["error"] is None:
                _store(tasks[number], files)
        except UserError as error:
            row = _failed(tasks[number], str(error))
        yield number, row
    yield from unread


def _prepare_remote(settings: RunSettings) -> Callable[[tuple[Task, bytes]], Any]:
    """The work of a process on a node: explains a photo's bytes, returns its row and its files' bytes."""
    work = _prepare(settings)

    def remote(item: tuple[Task, bytes]) -> tuple[dict[str, Any], dict[str, bytes]]:
        task, data = item
        with tempfile.TemporaryDirectory() as folder:
            here = Path(folder) / "photo" / task.photo.name
            here.parent.mkdir()
            here.write_bytes(data)
            row = work(replace(task, photo=here, folder=Path(folder) / "result" / task.folder.name))
            found = [path for path in (Path(folder) / "result").rglob("*") if path.is_file()]
            root = Path(folder) / "result" / task.folder.name
            files = {str(path.relative_to(root)): path.read_bytes() for path in found}
        error = row["error"] and row["error"].replace(str(here), str(task.photo))
        return row | {"photo": str(task.photo), "error": error}, files

    return remote


def _prepare(settings: RunSettings) -> Callable[[Task], dict[str, Any]]:
    """The work of a worker process."""
    explainer = Explainer(settings.object_class, settings.explain, settings.device)
    return _Work(explainer, settings.export)


@dataclass
class _Work:
    """Explains a photo, writes its folder, and returns its row."""

    explainer: Explainer
    export: tuple[str, ...]

    def __call__(self, task: Task) -> dict[str, Any]:
        began = time.monotonic()
        try:
            found = self.explainer.explain(task.photo, task.box, focal=task.focal, hints=task.hints)
            self.write(task, found)
        except UserError as error:
            return _failed(task, str(error))
        return row_of(task, found) | {"seconds": round(time.monotonic() - began, 3)}

    def write(self, task: Task, found: Explanation) -> None:
        """All files of a photo beside its folder, then in their place, explanation.json last."""
        with _beside(task) as beside:
            found.save(beside, task.photo.name)
            found.export(beside, self.export, task.photo.name)
            said = State.of(task.box, task.focal, found.hints)
            if said is not None:  # named from where it will be, which is as deep
                said.write(beside, task.photo, found.object_class)


def _store(task: Task, files: dict[str, bytes]) -> None:
    """Write files that a node sent; the photo that corrections.json names is here, not where it was sent."""
    with _beside(task) as beside:
        for name, data in files.items():
            path = beside / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(data)
        corrections = beside / CORRECTIONS
        if corrections.exists():
            told = json.loads(corrections.read_text())
            told["photo"] = os.path.relpath(task.photo.resolve(), beside.resolve())
            corrections.write_text(json.dumps(told, indent=2) + "\n")


@contextmanager
def _beside(task: Task) -> Iterator[Path]:
    """A folder to write into; when the block ends well it takes the place of the photo's, else it goes."""
    beside = task.folder.with_name(f".{task.folder.name}{PARTIAL}")
    shutil.rmtree(beside, ignore_errors=True)
    try:
        yield beside
        if not os.path.lexists(task.folder):
            os.rename(beside, task.folder)
            return
        (task.folder / "explanation.json").unlink(missing_ok=True)
        if not (beside / CORRECTIONS).exists():
            (task.folder / CORRECTIONS).unlink(missing_ok=True)
        for path in sorted(beside.iterdir(), key=lambda path: path.name == "explanation.json"):
            target = task.folder / path.name
            if path.is_dir():
                shutil.rmtree(target, ignore_errors=True)
            os.replace(path, target)
    except OSError as error:
        raise UserError(
            f"cannot write {task.folder}: {error.strerror or error}; choose another --out."
        ) from error
    finally:
        shutil.rmtree(beside, ignore_errors=True)


def row_of(task: Task, found: Explanation) -> dict[str, Any]:
    """The row of a photo that was explained."""
    said = found.to_dict()
    camera, deviation = said["camera"], said["deviation"]
    pose = {
        f"camera_from_object_{row}{column}": camera["camera_from_object"][row][column]
        for row in range(3)
        for column in range(4)
    }
    box = dict(zip(("box_x", "box_y", "box_width", "box_height"), said["box"] or [None] * 4, strict=True))
    row = {
        "photo": str(task.photo),
        "folder": task.folder.name,
        "error": None,
        "view_trusted": "view" in said["trusted"],
        "mask_trusted": "mask" in said["trusted"],
        "azimuth_deviation_deg": deviation["azimuth_deg"],
        "elevation_deviation_deg": deviation["elevation_deg"],
        **dict(zip(("albedo_r", "albedo_g", "albedo_b"), said["albedo"], strict=True)),
        **box,
        "width": camera["width"],
        "height": camera["height"],
        "focal_px": camera["K"][0][0],
        "center_x": camera["K"][0][2],
        "center_y": camera["K"][1][2],
        "focal_from": camera["focal_from"],
        **pose,
    }
    return {name: row[name] if name in row else said.get(name) for name in COLUMNS}


def _failed(task: Task, error: str) -> dict[str, Any]:
    return dict.fromkeys(COLUMNS) | {"photo": str(task.photo), "folder": task.folder.name, "error": error}


def write_table(
    out: Path, rows: Iterable[dict[str, Any]], table: str = TABLE, columns: Sequence[str] = COLUMNS
) -> list[Path]:
    """Write results.csv, and results.parquet where pyarrow is installed; returns what was written."""
    rows = [{name: row.get(name) for name in columns} for row in rows]
    with (
        atomic_write(out / f"{table}.csv") as temporary,
        open(temporary, "w", newline="", encoding="utf-8", errors="replace") as file,
    ):
        writer = csv.DictWriter(file, columns)
        writer.writeheader()
        writer.writerows(rows)
    written = [out / f"{table}.csv"]
    with suppress(ImportError):
        import pyarrow
        from pyarrow import parquet

        arrays = {name: pyarrow.array([_text(row[name]) for row in rows], _kind(name)) for name in columns}
        with atomic_write(out / f"{table}.parquet") as temporary:
            parquet.write_table(pyarrow.table(arrays), temporary)
        written.append(out / f"{table}.parquet")
    return written


def _text(value: Any) -> Any:
    """Text as UTF-8 has it: file names may hold other bytes."""
    return value.encode("utf-8", "replace").decode() if isinstance(value, str) else value


def _kind(name: str) -> Any:
    """A column's type, the same whatever the rows are, so that tables of several runs can be joined."""
    import pyarrow

    if name in ("photo", "folder", "error", "verdict", "family", "focal_from", "reason"):
        return pyarrow.string()
    return pyarrow.bool_() if name.endswith("_trusted") or name in ("lost", "refitted") else pyarrow.float64()


@contextmanager
def _ledger(out: Path) -> Iterator[Any]:
    """results.jsonl, to be added to by this run alone."""
    path = out / LEDGER
    try:
        out.mkdir(parents=True, exist_ok=True)
        file = open(path, "a+", encoding="utf-8")
    except OSError as error:
        raise UserError(f"cannot write {path}: {error.strerror}; choose another --out.") from error
    with file:
        try:
            import fcntl

            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except ImportError:  # no such locks on this system
            pass
        except OSError:
            raise UserError(
                f"another run is writing to '{out}'; wait until it ends or choose another --out."
            ) from None
        for left in out.glob(f".*{PARTIAL}"):
            shutil.rmtree(left, ignore_errors=True)
        yield file


def _done(ledger: Any) -> dict[str, dict[str, Any]]:
    """Rows of photos that were explained, by their keys; half a line, as a kill leaves it, is ended."""
    ledger.seek(0)
    found: dict[str, dict[str, Any]] = {}
    line = "\n"
    for line in ledger:
        with suppress(ValueError, KeyError, TypeError):
            told = json.loads(line)
            if told["row"]["error"] is None and isinstance(told["row"]["folder"], str):
                found[str(told["key"])] = told["row"]
    if not line.endswith("\n"):
        ledger.write("\n")
    return found


def _described(settings: RunSettings, explainer: Explainer) -> str:
    """What all photos' results depend on."""
    folder = explainer.object_class.folder
    files = [] if folder is None else sorted(folder.iterdir())
    pack = [(path.name, path.stat().st_size, path.stat().st_mtime_ns) for path in files]
    return repr((FORMAT, __version__, settings.explain, sorted(settings.export), str(folder), pack))


def _key(task: Task, said: str) -> str:
    """Tells whether a photo, its settings and what is said of it are those of a row."""
    try:
        stat = task.photo.stat()
        photo: Any = str(task.photo.resolve()), stat.st_size, stat.st_mtime_ns
    except OSError:
        photo = str(task.photo)
    digest = hashlib.sha256(repr((said, photo, str(task.folder), task.box, task.focal)).encode())
    if task.hints is not None:
        digest.update(repr(task.hints.described()).encode())
        for array in (task.hints.mask, task.hints.marks):
            digest.update(b"" if array is None else array.tobytes())
    return digest.hexdigest()
