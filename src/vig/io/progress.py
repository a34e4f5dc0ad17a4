"""Progress of a long command: a bar on a terminal, occasional lines in a log, or nothing."""

from __future__ import annotations

import sys
import time
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.progress import Progress

SECONDS = 30.0  # seconds after which a log gets a line, where `SHARE` does not come first
SHARE = 0.1  # share of the run after which a log gets a line
BETWEEN_MARKS = 1.0
"""Seconds between the times that a meter remembers, and of those that a rate is of, at least."""


class Meter:
    """Counts a run's finished items, samples by default, and reports on standard error; a context manager.

    Args:
        total: Number of items of the whole run.
        done: Number of items that exist at its start.
        show: Whether to report anything.
        unit: Name of the items.
        seconds: Seconds between lines in a log, at most.
    """

    def __init__(
        self, total: int, done: int, show: bool = True, unit: str = "samples", seconds: float = SECONDS
    ) -> None:
        self.unit = unit
        self.seconds = seconds
        self.total = total
        self.done = self.done_at_start = self.reported = done
        self.started = self.reported_at = time.monotonic()
        # Times and counts since the first samples were done: the start of a run is not its rate.
        self.marks: list[tuple[float, int]] = []
        self.bar: Progress | None = None
        self.show = show
        if show and sys.stderr.isatty():
            from rich.console import Console
            from rich.progress import BarColumn, MofNCompleteColumn, Progress, TaskProgressColumn, TextColumn

            columns = (TextColumn(unit), BarColumn(), MofNCompleteColumn(), TaskProgressColumn())
            self.bar = Progress(
                *columns,
                TextColumn("{task.fields[pace]}"),
                console=Console(stderr=True, soft_wrap=True),
                transient=True,
                redirect_stdout=sys.stdout.isatty(),  # a file gets its prints
            )
            self.task = self.bar.add_task("", total=total, completed=done, pace="")

    def __enter__(self) -> Meter:
        if self.bar is not None:
            self.bar.start()
        return self

    def __exit__(self, *error: object) -> None:
        if self.bar is not None:
            self.bar.stop()
        elif self.show and self.done != self.reported:
            self._report()

    def advance(self, count: int) -> None:
        """Count `count` more samples, to the total at the most."""
        self.done = min(self.done + count, self.total)
        now = time.monotonic()
        if not self.marks or now - self.marks[-1][0] >= BETWEEN_MARKS:
            self.marks.append((now, self.done))
        if self.bar is not None:
            self.bar.update(self.task, completed=self.done, pace=self.pace())
        elif self.show:
            late = time.monotonic() - self.reported_at >= self.seconds
            if late or self.done - self.reported >= SHARE * self.total:
                self._report()

    def pace(self) -> str:
        """Return the rate in the later half of this run so far, and the time left at that rate."""
        now = time.monotonic()
        start, done_then = self.started, self.done_at_start
        for marked_at, done in self.marks:
            early = marked_at - self.started <= (now - self.started) / 2
            long = now - marked_at >= BETWEEN_MARKS  # several may be done at once
            if (early or done_then == self.done_at_start) and done < self.done and long:
                start, done_then = marked_at, done
        rate = (self.done - done_then) / (now - start) if now - start >= BETWEEN_MARKS else 0.0
        if rate == 0:
            return ""
        speed = f"{rate:.1f}/s" if rate >= 1 else f"{1 / rate:.1f} s each"
        minutes, seconds = divmod(round((self.total - self.done) / rate), 60)
        hours, minutes = divmod(minutes, 60)
        clock = f"{hours}:{minutes:02d}:{seconds:02d}" if hours else f"{minutes}:{seconds:02d}"
        return f"{speed}, {clock} left"

    def _report(self) -> None:
        self.reported, self.reported_at = self.done, time.monotonic()
        words = [f"{self.done} of {self.total} {self.unit}", self.pace()]
        print(", ".join(filter(None, words)), file=sys.stderr, flush=True)
