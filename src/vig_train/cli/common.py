"""What several verbs need."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

from vig.io.errors import UserError
from vig.io.files import atomic_write


def check_writable(folder: Path) -> None:
    """Refuse now a folder that could not be written after an hour's work."""
    probe = folder / ".writable"
    with atomic_write(probe) as temporary:
        temporary.touch()
    probe.unlink()


def command_line(
    verb: str, settings: Any, positional: Sequence[str] = (), skipped: Sequence[str] = ()
) -> str:
    """Return the command of a verb with these settings, a dataclass.

    Args:
        verb: With `vig` before it.
        settings: What differs from the defaults is stated.
        positional: Names of those that come first and without a flag.
        skipped: Names of those that do not change the result.
    """
    words = [*verb.split(), *(str(getattr(settings, name)) for name in positional)]
    for field in fields(settings):
        value, flag = getattr(settings, field.name), field.name.replace("_", "-")
        if field.name in (*positional, *skipped) or value == field.default:
            continue
        if isinstance(value, bool):
            words.append(f"--{flag}" if value else f"--no-{flag}")
        elif isinstance(value, tuple):
            words += [f"--{flag}", *map(str, value)]
        else:
            words += [f"--{flag}={value}"] if str(value).startswith("-") else [f"--{flag}", str(value)]
    return shlex.join(words)


def check_workers(workers: int | None) -> None:
    """Refuse a number of workers that can do nothing."""
    if workers is not None and workers < 1:
        raise UserError(f"expected --workers of at least 1; got {workers}.")
