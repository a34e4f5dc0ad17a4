"""A run's photos on a Ray cluster: they go as bytes, and files come back as bytes and are written here."""

import json
import os
import tempfile
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from itertools import count
from pathlib import Path
from typing import Any, TypeVar

from vig.io.errors import UserError
from vig.io.files import write_json
from vig.parallel import Lost
from vig.parallel.cluster import map_on_cluster
from vig.photo.checks import existing_file
from vig_app.corrections import CORRECTIONS
from vig_app.runs.work import Rows, RunSettings, Task, beside_folder, failure_rows, lost_row, prepare

Item = TypeVar("Item")
Sent = tuple[Task, bytes, bytes | None]  # a task, its photo's bytes and its mask's, as a node gets them


def rows_of_cluster(
    tasks: Iterable[Task], settings: RunSettings, address: str
) -> Iterator[tuple[Task, Rows]]:
    """Yield rows as `_rows` does; photos go as bytes, and files come back as bytes and are written here."""
    unread: deque[tuple[Task, Rows]] = deque()
    sent: dict[int, Task] = {}
    numbers = count()

    def items() -> Iterator[Sent]:
        for task in tasks:
            try:
                photo = existing_file(task.photo).read_bytes()
                mask = None if task.mask is None else existing_file(task.mask).read_bytes()
            except (UserError, OSError) as error:
                unread.append((task, failure_rows(task, error)))
                continue
            sent[next(numbers)] = task
            yield task, photo, mask

    for number, answer in map_on_cluster(prepare_remote, settings, items(), address):
        yield from take_waiting(unread)
        task = sent.pop(number)
        if isinstance(answer, Lost):
            yield task, lost_row(task, answer)
            continue
        rows, files = answer
        try:
            if rows[0]["error"] is None:
                _store(task, files)
        except UserError as error:
            rows = failure_rows(task, error)
        yield task, rows
    yield from take_waiting(unread)


def prepare_remote(settings: RunSettings) -> Callable[[Sent], Any]:
    """Return the work of a process on a node: explains a photo's bytes, returns its rows and files' bytes."""
    work = prepare(settings)

    def remote(item: Sent) -> tuple[Rows, dict[str, bytes]]:
        task, photo, mask = item
        with tempfile.TemporaryDirectory() as folder:
            photo_path, mask_path = _put(Path(folder) / "photo" / task.photo.name, photo), None
            if task.mask is not None and mask is not None:
                mask_path = _put(Path(folder) / "mask" / task.mask.name, mask)
            root = Path(folder) / "result" / task.folder.name
            rows = work(replace(task, photo=photo_path, mask=mask_path, folder=root))
            paths = [path for path in root.rglob("*") if path.is_file()]
            files = {str(path.relative_to(root)): path.read_bytes() for path in paths}
        for row in rows:
            row["photo"] = str(task.photo)
            if row["error"] is not None:
                error = row["error"].replace(str(photo_path), str(task.photo))
                row["error"] = error.replace(str(mask_path), str(task.mask))
        return rows, files

    return remote


def _put(path: Path, data: bytes) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(data)
    return path


def _store(task: Task, files: dict[str, bytes]) -> None:
    """Write a node's files; the photo that corrections.json names is on this machine, not on the node."""
    with beside_folder(task) as beside:
        for name, data in files.items():
            _put(beside / name, data)
        for corrections in beside.rglob(CORRECTIONS):
            content = json.loads(corrections.read_text())
            content["photo"] = os.path.relpath(task.photo.resolve(), corrections.parent.resolve())
            write_json(corrections, content)


def take_waiting(waiting: deque[Item]) -> Iterator[Item]:
    """Yield all waiting items, removing them."""
    while waiting:
        yield waiting.popleft()
