"""A run over photos: a folder of results for each, a ledger to resume from, one table.

What is done stays, whatever ends the run: a photo's folder appears when it is complete, and its row in
`results.jsonl` after that. A photo whose row is there is not fitted again while photo, settings and class are
the same.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
import shutil
import tempfile
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from itertools import chain, count, islice
from pathlib import Path
from typing import Any, TypeVar

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
from vig.photo.images import existing_file, read_mask
from vig.results import COLUMNS, POSE, TRACK, TRACK_COLUMNS, write_table
from vig.together import explain_found, explain_together
from vig.tracking import Track, TrackedFrame, track

Item = TypeVar("Item")
LEDGER = "results.jsonl"
PARTIAL = ".partial"
FORMAT = 1


@dataclass(frozen=True)
class Task:
    """One photo, the folder of its results, and what is said of it.

    Attributes:
        photo: Its file.
        folder: Within that of the run.
        box: Round its one object; None where that is to be found.
        focal: In pixels, where it is known.
        hints: On its one object.
        mask: A file, read with the photo.
        objects: Class and box of each of several objects, which are explained together.
        most: So many objects, of any of the run's classes, are to be found and explained together.
    """

    photo: Path
    folder: Path
    box: Box | None = None
    focal: float | None = None
    hints: Hints | None = None
    mask: Path | None = None
    objects: tuple[tuple[str, Box], ...] = ()
    most: int = 0


Rows = list[dict[str, Any]]
"""Of one photo: a row for each object, or one with the error."""
Sent = tuple[Task, bytes, bytes | None]
"""A task, its photo's bytes and its mask's, as a node gets them."""


@dataclass(frozen=True)
class RunSettings:
    """What a run does with each photo.

    Attributes:
        object_class: A packaged class or the folder of a pack.
        others: Further classes that objects may be of, where a photo has several.
        explain: How to fit.
        device: See `Explainer`.
        export: Formats that are written, too; see `Explanation.export`.
    """

    object_class: str | Path = "teapot"
    explain: ExplainSettings = ExplainSettings()
    device: str = "cpu"
    export: tuple[str, ...] = ()
    others: tuple[str, ...] = ()


def run(
    tasks: Iterable[Task],
    out: Path,
    settings: RunSettings,
    workers: int = 1,
    resume: bool = True,
    cluster: str | None = None,
) -> Iterator[dict[str, Any]]:
    """Explain photos into their folders, and yield the row of each object as it is done, `COLUMNS`.

    Args:
        tasks: Any number, with folders within `out`; they are taken as they are needed.
        out: Holds the ledger.
        settings: For all photos.
        workers: Processes; with 1 it is done in this one, in order. One that is killed is replaced.
        resume: Keep a ledger, which no other run may be writing to. Photos that it has are not fitted again;
            their rows have "done_before".
        cluster: Address of a Ray cluster in place of workers, `auto` for the one of this machine. Photos are
            sent to its nodes and results come back: they need vig and the class, but no shared disk.

    Raises:
        UserError: The class cannot be loaded, `out` cannot be written, another run writes there, or there is
            no such cluster.
    """
    explainer = Explainer(settings.object_class, settings.explain, settings.device)
    if not resume:
        for _, rows in _rows(tasks, settings, explainer, workers, cluster):
            yield from rows
        return
    with _ledger(out) as ledger:
        done, said = _done(ledger), _described(settings, explainer)
        keys: dict[str, str] = {}
        before: deque[dict[str, Any]] = deque()

        def waiting() -> Iterator[Task]:
            for task in tasks:
                key = _key(task, said)
                rows = done.pop(key, [])  # each is kept once
                if rows and all((out / row["folder"] / "explanation.json").exists() for row in rows):
                    before.extend(row | {"done_before": True} for row in rows)
                else:
                    keys[str(task.folder)] = key
                    yield task

        for task, rows in _rows(waiting(), settings, explainer, workers, cluster):
            try:
                ledger.write(json.dumps({"key": keys.pop(str(task.folder)), "rows": rows}) + "\n")
                ledger.flush()
            except OSError as error:
                raise UserError(
                    f"cannot write {out / LEDGER}: {error.strerror}; what is done stays. Make room and run"
                    " the same command again."
                ) from error
            yield from _taken(before)
            yield from rows
        yield from _taken(before)


def _taken(waiting: deque[Item]) -> Iterator[Item]:
    """Take all that is there."""
    while waiting:
        yield waiting.popleft()


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
    work, began = _Work(explainer, settings), [time.monotonic()]

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
    tasks: Iterable[Task], settings: RunSettings, explainer: Explainer, workers: int, cluster: str | None
) -> Iterator[tuple[Task, Rows]]:
    """Tasks and their rows as they are done; tasks are taken as they are needed."""
    if cluster is not None:
        yield from _rows_of_cluster(tasks, settings, cluster)
        return
    tasks = iter(tasks)
    first = list(islice(tasks, 2))
    tasks = chain(first, tasks)
    if workers == 1 or len(first) < 2:
        work = _Work(explainer, settings)
        yield from ((task, work(task)) for task in tasks)
        return
    given: dict[int, Task] = {}

    def noted() -> Iterator[Task]:
        for number, task in enumerate(tasks):
            given[number] = task
            yield task

    for number, rows in map_as_done(_prepare, settings, noted(), workers):
        task = given.pop(number)
        yield task, _lost(task, rows) if isinstance(rows, Lost) else rows


def _lost(task: Task, lost: Lost) -> Rows:
    return _failed(
        task,
        f"{task.photo}: a worker process was killed {lost.attempts} times while it explained this photo,"
        " possibly out of memory; try it alone.",
    )


def _rows_of_cluster(
    tasks: Iterable[Task], settings: RunSettings, address: str
) -> Iterator[tuple[Task, Rows]]:
    """As `_rows`; photos go as bytes, and files come back as bytes and are written here."""
    unread: deque[tuple[Task, Rows]] = deque()
    given: dict[int, Task] = {}
    numbers = count()

    def items() -> Iterator[Sent]:
        for task in tasks:
            try:
                photo = existing_file(task.photo).read_bytes()
                mask = None if task.mask is None else existing_file(task.mask).read_bytes()
            except (UserError, OSError) as error:
                unread.append((task, _failed(task, error)))
                continue
            given[next(numbers)] = task
            yield task, photo, mask

    for number, found in map_on_cluster(_prepare_remote, settings, items(), address):
        yield from _taken(unread)
        task = given.pop(number)
        if isinstance(found, Lost):
            yield task, _lost(task, found)
            continue
        rows, files = found
        try:
            if rows[0]["error"] is None:
                _store(task, files)
        except UserError as error:
            rows = _failed(task, error)
        yield task, rows
    yield from _taken(unread)


def _prepare_remote(settings: RunSettings) -> Callable[[Sent], Any]:
    """The work of a process on a node: explains a photo's bytes, returns its rows and its files' bytes."""
    work = _prepare(settings)

    def remote(item: Sent) -> tuple[Rows, dict[str, bytes]]:
        task, photo, mask = item
        with tempfile.TemporaryDirectory() as folder:
            here = _put(Path(folder) / "photo" / task.photo.name, photo)
            of_mask = None
            if task.mask is not None and mask is not None:
                of_mask = _put(Path(folder) / "mask" / task.mask.name, mask)
            root = Path(folder) / "result" / task.folder.name
            rows = work(replace(task, photo=here, mask=of_mask, folder=root))
            found = [path for path in root.rglob("*") if path.is_file()]
            files = {str(path.relative_to(root)): path.read_bytes() for path in found}
        for row in rows:
            row["photo"] = str(task.photo)
            if row["error"] is not None:
                told = row["error"].replace(str(here), str(task.photo))
                row["error"] = told.replace(str(of_mask), str(task.mask))
        return rows, files

    return remote


def _put(path: Path, data: bytes) -> Path:
    path.parent.mkdir()
    path.write_bytes(data)
    return path


def _prepare(settings: RunSettings) -> Callable[[Task], Rows]:
    """The work of a worker process."""
    return _Work(Explainer(settings.object_class, settings.explain, settings.device), settings)


class _Work:
    """Explains a photo, writes its folder, and returns its rows, one for each object."""

    def __init__(self, explainer: Explainer, settings: RunSettings):
        self.explainer, self.settings, self.export = explainer, settings, settings.export
        self.by_class = {str(settings.object_class): explainer}

    def __call__(self, task: Task) -> Rows:
        began = time.monotonic()
        try:
            if task.objects or task.most:
                rows = self.several(task)
                seconds = round((time.monotonic() - began) / len(rows), 3)
                return [row | {"seconds": seconds} for row in rows]
            hints = task.hints
            if task.mask is not None:
                hints = replace(hints or Hints(), mask=read_mask(task.mask))
            found = self.explainer.explain(task.photo, task.box, focal=task.focal, hints=hints)
            self.write(task, found)
        except UserError as error:
            return _failed(task, error)
        return [row_of(task, found) | {"seconds": round(time.monotonic() - began, 3)}]

    def of_class(self, name: str) -> Explainer:
        """The explainer of a class, which is loaded when it is first needed."""
        if name not in self.by_class:
            self.by_class[name] = Explainer(name, self.settings.explain, self.settings.device)
        return self.by_class[name]

    def several(self, task: Task) -> Rows:
        """The rows of a photo of several objects."""
        if task.objects:
            explainers = [self.of_class(name) for name, _ in task.objects]
            boxes = [box for _, box in task.objects]
            scene = explain_together(task.photo, explainers, boxes, task.focal)
        else:
            names = (str(self.settings.object_class), *self.settings.others)
            scene = explain_found(task.photo, [self.of_class(name) for name in names], task.most, task.focal)
        with _beside(task) as beside:
            scene.save(beside, task.photo.name, self.export)
        return [
            row_of(task, found) | {"folder": f"{task.folder.name}/{name}", "object": number}
            for number, (name, found) in enumerate(zip(scene.names, scene.objects, strict=True), 1)
        ]

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
        "object": 1,
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


def _failed(task: Task, error: object) -> Rows:
    """The one row of a photo that was not explained; the reason names the photo."""
    name, told = str(task.photo), str(error)
    told = told if str(UserError(name)) in told else f"{name}: {told}"
    return [dict.fromkeys(COLUMNS) | {"photo": name, "folder": task.folder.name, "error": told}]


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
        except BlockingIOError:
            raise UserError(
                f"another run is writing to '{out}'; wait until it ends or choose another --out."
            ) from None
        except OSError as error:  # some network disks have none
            raise UserError(
                f"cannot lock {path}: {error.strerror}; choose an --out on a disk with file locks."
            ) from error
        for left in out.glob(f".*{PARTIAL}"):
            shutil.rmtree(left, ignore_errors=True)
        yield file


def _done(ledger: Any) -> dict[str, Rows]:
    """Rows of photos that were explained, by their keys; half a line, as a kill leaves it, is ended."""
    ledger.seek(0)
    found: dict[str, Rows] = {}
    line = "\n"
    for line in ledger:
        with suppress(ValueError, KeyError, TypeError):
            told = json.loads(line)
            if all(row["error"] is None and isinstance(row["folder"], str) for row in told["rows"]):
                found[str(told["key"])] = told["rows"]
    if not line.endswith("\n"):
        ledger.write("\n")
    return found


def _described(settings: RunSettings, explainer: Explainer) -> str:
    """What all photos' results depend on."""
    folder = explainer.object_class.folder
    files = [] if folder is None else sorted(folder.iterdir())
    pack = [(path.name, path.stat().st_size, path.stat().st_mtime_ns) for path in files]
    what = settings.explain, sorted(settings.export), settings.others
    return repr((FORMAT, __version__, what, str(folder), pack))


def _key(task: Task, said: str) -> str:
    """Tells whether a photo, its settings and what is said of it are those of a row."""
    about = task.box, task.focal, task.objects, task.most
    digest = hashlib.sha256(repr((said, _stamp(task.photo), str(task.folder), about)).encode())
    if task.mask is not None:
        digest.update(repr(_stamp(task.mask)).encode())
    if task.hints is not None:
        digest.update(repr(task.hints.described()).encode())
        for array in (task.hints.mask, task.hints.marks):
            digest.update(b"" if array is None else array.tobytes())
    return digest.hexdigest()


def _stamp(path: Path) -> Any:
    """What changes when a file does."""
    try:
        stat = path.stat()
    except OSError:
        return str(path)
    return str(path.resolve()), stat.st_size, stat.st_mtime_ns
