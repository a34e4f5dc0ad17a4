"""How far a run is: a bar on a terminal, a line now and then in a log, nothing when not wanted."""

from __future__ import annotations

import sys
import time
from types import TracebackType

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TaskProgressColumn, TextColumn

SECONDS, SHARE = 30.0, 0.1
"""A log gets a line when so much time has passed or so much of the whole is done, whichever is first."""


class Meter:
    """Counts samples, or what `unit` names, of a run of `total`, of which `done` were there at its start.

    Use as a context.

    Args:
        show: False says nothing. Everything goes to standard error.
    """

    def __init__(self, total: int, done: int, show: bool = True, unit: str = "samples") -> None:
        self.unit = unit
        self.total, self.done, self.before = total, done, done
        self.started = self.said_at = time.monotonic()
        self.said = done
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
        elif self.show and self.done != self.said:
            self._say()

    def advance(self, count: int) -> None:
        """So many more samples are done."""
        self.done += count
        if self.bar is not None:
            self.bar.update(self.task, completed=self.done, pace=self.pace())
        elif self.show:
            late = time.monotonic() - self.said_at >= SECONDS
            if late or self.done - self.said >= SHARE * self.total:
                self._say()

    def pace(self) -> str:
        """Rate since the start of this run and the time left at that rate."""
        elapsed = time.monotonic() - self.started
        rate = (self.done - self.before) / elapsed if elapsed > 0 else 0.0
        if rate == 0:
            return ""
        speed = f"{rate:.1f}/s" if rate >= 1 else f"{1 / rate:.1f} s each"
        return f"{speed}, {_clock((self.total - self.done) / rate)} left"

    def _say(self) -> None:
        self.said, self.said_at = self.done, time.monotonic()
        print(f"{self.done} of {self.total} {self.unit}, {self.pace()}", file=sys.stderr, flush=True)


def _clock(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{rest:02d}" if hours else f"{minutes}:{rest:02d}"
