"""How many photos of a run are done, and the time left: a line on a terminal, elsewhere nothing."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager


@contextmanager
def progress_of(photos: int, quiet: bool) -> Iterator[Callable[[int], None]]:
    """Show a line on standard error while the block runs; yields what sets the number of photos done.

    Nothing is shown of a single photo, when `quiet`, or where standard error is no terminal.
    """
    if quiet or photos < 2 or not sys.stderr.isatty():
        yield lambda done: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (
        TextColumn("photos"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
        TextColumn("left"),
    )
    console = Console(stderr=True, soft_wrap=True)
    # What is printed to a terminal meanwhile goes above the line; to a file, there.
    with Progress(*columns, console=console, transient=True, redirect_stdout=sys.stdout.isatty()) as shown:
        task = shown.add_task("", total=photos)
        yield lambda done: shown.update(task, completed=done)
