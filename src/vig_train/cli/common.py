"""Functions that several verbs share."""

import math
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
        verb: The verb, with `vig` before it.
        settings: A dataclass; fields that differ from the defaults are stated.
        positional: Names of fields that come first and without a flag.
        skipped: Names of fields that do not change the result.
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


def check_ranges(settings: Any, **ranges: tuple[float, float]) -> None:
    """Refuse options of a verb that are out of their ranges, both ends included; None is in any.

    ranges: Least and greatest value by name; `inf` for no greatest.
    """
    for name, (least, most) in ranges.items():
        value = getattr(settings, name)
        if value is not None and not least <= value <= most:
            within = f"of at least {least:g}" if most == math.inf else f"from {least:g} to {most:g}"
            raise UserError(f"expected --{name.replace('_', '-')} {within}; got {value:g}.")
