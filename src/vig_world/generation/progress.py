"""Progress of a run: a bar on a terminal, occasional lines in a log, or nothing."""

from __future__ import annotations

import sys
import time
from types import TracebackType

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TaskProgressColumn, TextColumn

SECONDS, SHARE = 30.0, 0.1
"""A log gets a line after this many seconds or this share of the run, whichever comes first."""


BETWEEN_MARKS = 1.0
"""Seconds between the times that a meter remembers, at least."""


class Meter:
    """Counts the samples of a run and reports on standard error; a context manager.

    Args:
        total: Samples of the whole run.
        done: Samples that exist at its start.
        show: Whether to report anything.
        unit: What is counted.
        seconds: Between lines in a log, at most.
    """

    def __init__(
        self, total: int, done: int, show: bool = True, unit: str = "samples", seconds: float = SECONDS
    ) -> None:
        self.unit, self.seconds = unit, seconds
        self.total, self.done, self.before = total, done, done
        self.started = self.reported_at = time.monotonic()
        self.reported = done
        # Times and counts since the first samples came: what begins a run is not its rate.
        self.marks: list[tuple[float, int]] = []
        self.bar: Progress | None = None
        self.show = show
        if show and sys.stderr.isatty():
            columns = (TextColumn(unit), BarColumn(), MofNCompleteColumn(), TaskProgressColumn())
            self.bar = Progress(*columns, TextColumn("{task.fields[pace]}"), console=Console(stderr=True))
            self.task = self.bar.add_task("", total=total, completed=done, pace="")

    def __enter__(self) -> Meter:
        if self.bar is not None:
            self.bar.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self.bar is not None:
            self.bar.stop()
        elif self.show and self.done != self.reported:
            self._report()

    def advance(self, count: int) -> None:
        """Count `count` more samples."""
        self.done += count
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
        """Rate in the later half of this run so far, and the time left at that rate."""
        now = time.monotonic()
        since, then = self.started, self.before
        for when, done in self.marks:
            if (when - self.started <= (now - self.started) / 2 or then == self.before) and done < self.done:
                since, then = when, done
        rate = (self.done - then) / (now - since) if now > since else 0.0
        if rate == 0:
            return ""
        speed = f"{rate:.1f}/s" if rate >= 1 else f"{1 / rate:.1f} s each"
        return f"{speed}, {_clock((self.total - self.done) / rate)} left"

    def _report(self) -> None:
        self.reported, self.reported_at = self.done, time.monotonic()
        print(f"{self.done} of {self.total} {self.unit}, {self.pace()}", file=sys.stderr, flush=True)


def _clock(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{rest:02d}" if hours else f"{minutes}:{rest:02d}"
