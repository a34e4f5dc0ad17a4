"""A run over photos: a folder of results for each, a ledger to resume from, one table.

Finished photos stay, whatever ends the run: a photo's folder appears when it is complete, and its row in
`results.jsonl` after that. A photo whose row is there is not refitted while photo, settings and class stay.
"""

import json
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator
from dataclasses import replace
from itertools import chain, islice
from pathlib import Path
from typing import Any

from vig.explainer import Explainer
from vig.io.errors import UserError
from vig.parallel import Lost, check_main_module, map_as_done
from vig_app.runs.ledger import LEDGER, is_done, key_of, ledger_of, rows_done, settings_key
from vig_app.runs.remote import rows_of_cluster, take_waiting
from vig_app.runs.work import Rows, RunSettings, Task, Work, lost_row, prepare


def run(
    tasks: Iterable[Task],
    out: Path,
    settings: RunSettings,
    workers: int = 1,
    resume: bool = True,
    cluster: str | None = None,
    finish: Callable[[], None] = lambda: None,
) -> Generator[dict[str, Any], None, None]:
    """Explain photos into their folders, and yield the row of each object as it is done, `COLUMNS`.

    Args:
        tasks: Any number, with folders within `out`; they are taken as they are needed.
        out: Folder that holds the ledger.
        settings: Settings for all photos.
        workers: Processes; with 1 it is done in this one, in order. One that is killed is replaced.
        resume: Keep a ledger, which no other run may be writing to. Photos that it has are not fitted again;
            their rows have "done_before".
        cluster: Address of a Ray cluster in place of workers, `auto` for the one of this machine. Photos are
            sent to its nodes and results come back: they need vig and the class, but no shared disk.
        finish: Called last, however the run ends, while no other run can write to `out`; close the
            iterator where it is left before its end. It needs a ledger.

    Raises:
        UserError: The class cannot be loaded, `out` cannot be written, another run writes there, or there is
            no such cluster.
    """
    if workers > 1:
        check_main_module()
    explainer = Explainer(settings.object_class, settings.explain)
    shared_key = settings_key(settings, explainer)
    if not resume:
        keyed = (replace(task, key=key_of(task, shared_key)) for task in tasks)
        for _, rows in _rows(keyed, settings, explainer, workers, cluster):
            yield from rows
        return
    with ledger_of(out) as ledger:
        done = rows_done(ledger)
        rows_of_before: deque[dict[str, Any]] = deque()

        def waiting() -> Iterator[Task]:
            for task in tasks:
                key = key_of(task, shared_key)
                written_key, rows = done.pop(task.folder.name, ("", []))  # in memory once
                if written_key == key and is_done(task, key, rows):
                    rows_of_before.extend(row | {"done_before": True} for row in rows)
                else:
                    yield replace(task, key=key)

        try:
            for task, rows in _rows(waiting(), settings, explainer, workers, cluster):
                try:
                    ledger.write(json.dumps({"key": task.key, "rows": rows}) + "\n")
                    ledger.flush()
                except OSError as error:
                    raise UserError(
                        f"cannot write {out / LEDGER}: {error.strerror}; what is done stays. Make room and"
                        " run the same command again."
                    ) from error
                yield from take_waiting(rows_of_before)
                yield from rows
            yield from take_waiting(rows_of_before)
        finally:
            finish()


def _rows(
    tasks: Iterable[Task], settings: RunSettings, explainer: Explainer, workers: int, cluster: str | None
) -> Iterator[tuple[Task, Rows]]:
    """Yield tasks and their rows as they are done; tasks are taken as they are needed."""
    if cluster is not None:
        yield from rows_of_cluster(tasks, settings, cluster)
        return
    tasks = iter(tasks)
    first_two = list(islice(tasks, 2))
    tasks = chain(first_two, tasks)
    if workers == 1 or len(first_two) < 2:
        work = Work(explainer, settings)
        yield from ((task, work(task)) for task in tasks)
        return
    begun: dict[int, Task] = {}

    def numbered() -> Iterator[Task]:
        for number, task in enumerate(tasks):
            begun[number] = task
            yield task

    for number, rows in map_as_done(prepare, settings, numbered(), workers):
        task = begun.pop(number)
        yield task, lost_row(task, rows) if isinstance(rows, Lost) else rows
