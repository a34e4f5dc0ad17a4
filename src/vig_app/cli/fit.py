"""`vig fit`: photos explained, a folder each."""

import json
import shlex
import sys
from collections.abc import Callable, Iterable
from contextlib import closing
from datetime import datetime
from functools import partial
from pathlib import Path
from typing import Any

from vig import __version__
from vig.io.errors import UserError
from vig.io.printing import end, in_one_line, note
from vig.io.progress import Meter
from vig.record import read_explanation
from vig_app.cli.options import FitCommand, RunOptions
from vig_app.cli.tasks import Plan, plan_of
from vig_app.corrections import CORRECTIONS
from vig_app.exports import export_run, remove_exports, run_formats
from vig_app.report.folder_page import write_run_page
from vig_app.report.sheet import write_sheets
from vig_app.results import RowsOnDisk, name_of, write_table
from vig_app.runs import run

Take = Callable[[dict[str, Any]], None]


def fit(command: FitCommand) -> int:
    """Explain every photo into a folder of its own; returns the exit code."""
    plan, options = plan_of(command), command.run

    def explain(take: Take, finish: Callable[[], None]) -> None:
        how = options.workers, len(plan.tasks) > 1, options.cluster
        with closing(run(plan.tasks, options.out, plan.settings, *how, finish)) as rows:
            for row in rows:
                take(row)

    return write_results(plan, options, explain, partial(_next, plan, options.out))


def write_results(
    plan: Plan,
    options: RunOptions,
    explain: Callable[[Take, Callable[[], None]], None],
    summarise: Callable[[int], str],
) -> int:
    """Explain photos and print a line of each; write their table and pages; return the exit code.

    Args:
        plan: Tasks of the photos.
        options: Where to write and what to print.
        explain: Explains them. It is given a function that takes a row as it is done, and one to call last,
            however it ends, while no other run can write there.
        summarise: Describes the results and next steps, from the number of rows without an error.
    """
    out, tasks, lines = options.out, plan.tasks, not options.json and not options.quiet
    log = partial(_add_line, options.log)
    log(f"vig {__version__}: {len(tasks)} photos into '{out}'")
    rows = RowsOnDisk(task.folder.name for task in tasks)
    made_anew, failed = False, 0

    def take(row: dict[str, Any]) -> None:
        nonlocal made_anew, failed
        rows.add(row)
        made_anew |= not row.get("done_before")
        failed += row["error"] is not None
        meter.advance(len(rows) - meter.done)
        line = in_one_line(_line(row))
        log(line)
        if row["error"] is not None:
            note(row["error"])
        elif lines:
            print(line, flush=True)

    def finish() -> None:
        if len(rows):
            if made_anew:
                remove_exports(out, of_run=True)  # from the results before
            write_table(out, rows)
            write_run_page(out, rows)
            write_sheets(out, rows)

    show_progress = len(tasks) > 1 and not options.quiet and sys.stderr.isatty()
    with Meter(len(tasks), 0, show_progress, "photos") as meter:
        explain(take, finish)
    if len(tasks) > 1 and (formats := [name for name in options.export if name in run_formats()]):
        export_run(out, formats)
    if options.json:
        errors = {row["photo"]: row["error"] for row in rows if row["error"] is not None}
        print(json.dumps({"results": _results(rows, out), "errors": errors, "folder": str(out)}, indent=2))
    elif failed < len(rows):
        if options.quiet:
            print(out)
        else:
            end(out, summarise(len(rows) - failed))
    return 0 if not failed else 1 if failed < len(rows) else 2


def _next(plan: Plan, out: Path, explained: int) -> str:
    """Return a summary of the results, and the next steps."""
    count = len(plan.tasks)
    folder = plan.tasks[0].folder if count == 1 else out
    made = "explained" if count == 1 else f"explained {explained} of {count} photos"
    if count == 1 and not any(folder.glob(f"**/{CORRECTIONS}")):  # a mask, marks or a pose was given
        return f"{made}: {where_to_look(folder)}"
    order = "" if count == 1 else ", the least sure first"
    return f"{made}: {where_to_look(folder)}; to correct{order}: vig view {shlex.quote(str(folder))}"


def where_to_look(folder: Path) -> str:
    """Return the page of a folder of results, where it has one."""
    page = folder / "report.html"
    return f"open {page}" if page.exists() else f"the files are in {folder}"


def _results(rows: Iterable[dict[str, Any]], out: Path) -> dict[str, Any]:
    """Return each explanation.json's content, by photo; a list of them where a photo has several objects."""
    results: dict[str, Any] = {}
    for row in rows:
        if row["error"] is None:
            folder = out / row["folder"]
            result = read_explanation(folder) | {"folder": str(folder)}
            if "/" in row["folder"]:
                results.setdefault(row["photo"], []).append(result)
            else:
                results[row["photo"]] = result
    return results


def _add_line(log: Path | None, words: str) -> None:
    """Add a line with the time to a file, where there is one; UserError when it cannot be written."""
    if log is None:
        return
    try:
        with open(log, "a", encoding="utf-8", errors="replace") as file:
            print(datetime.now().isoformat(timespec="seconds"), words, file=file)
    except OSError as error:
        raise UserError(
            f"expected --log FILE that can be written; got '{log}' ({error.strerror}). Name another."
        ) from None


def _line(row: dict[str, Any]) -> str:
    """Return the printed line of a row."""
    if row["error"] is not None:
        return f"error: {row['error']}"
    when = "done before" if row.get("done_before") else f"{row['seconds']:.1f} s"
    if row["verdict"] == "absent":
        return f"absent: {name_of(row)}; {row['reason']} ({when})"
    hidden, mask_confidence = row["hidden_fraction"], row["mask_confidence"]
    trust = " trusted," if row["mask_trusted"] else " not trusted,"
    trust = "" if row["mask_trusted"] == row["view_trusted"] else trust  # the verdict is of the view
    mask = "" if mask_confidence is None else f" (mask{trust} {mask_confidence:.0%} likely right)"
    visible = "nothing seen" if hidden is None else f"{hidden:.0%} hidden{mask}"
    if row["focal_from"] == "assumed":
        visible += ", distance unknown (focal length assumed)"
    colour = ", ".join(f"{row[f'albedo_{name}']:.2f}" for name in "rgb")
    right = "" if row["confidence"] is None else f" ({row['confidence']:.0%} likely right)"
    return (
        f"{row['verdict']}: {name_of(row)}, azimuth {row['azimuth_deg']:.1f}, elevation"
        f" {row['elevation_deg']:.1f} degrees{right}, albedo ({colour}), {visible}; {row['reason']} ({when})"
    )
