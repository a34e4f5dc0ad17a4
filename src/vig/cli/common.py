"""Verbs of the command line, and what several of them need."""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TimeElapsedColumn, TimeRemainingColumn

from vig.errors import UserError
from vig.files import atomic_write

GROUP = "vig.verbs"
"""Entry points under which a package hands its verbs, a tuple of `Verb`, to the command line."""


@dataclass(frozen=True)
class Verb:
    """One verb. Its work is imported when it is chosen, so that help is quick.

    name: `fit`, or `dataset make` for a verb of a group. settings: a dataclass, from which the arguments are
    derived. work: `module:function`, which takes the settings and returns the exit code.
    """

    name: str
    settings: type
    work: str

    def run(self, settings: Any) -> int:
        """Do the work with these settings; returns the exit code."""
        module, _, function = self.work.partition(":")
        code: int = getattr(import_module(module), function)(settings)
        return code


def verbs_of_packages() -> tuple[Verb, ...]:
    """The verbs that installed packages bring, in the order of their entry points' names."""
    found = sorted(entry_points(group=GROUP), key=lambda point: point.name)
    return tuple(verb for point in found for verb in point.load())


def check_writable(folder: Path) -> None:
    """Refuse now a folder that could not be written after an hour's work."""
    probe = folder / ".writable"
    with atomic_write(probe) as temporary:
        temporary.touch()
    probe.unlink()


def check_workers(workers: int | None) -> None:
    """Refuse a number of workers that can do nothing."""
    if workers is not None and workers < 1:
        raise UserError(f"expected --workers of at least 1; got {workers}.")


def progress_bar(quiet: bool) -> Progress:
    """A bar on standard error, where that is a terminal."""
    console = Console(stderr=True)
    return Progress(
        "{task.description}",
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
        console=console,
        disable=quiet or not console.is_terminal,
    )
