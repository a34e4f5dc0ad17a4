"""The lines that commands print."""

import json
import os
import sys
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any


def note(words: str) -> None:
    """Print an error or a remark in one line on stderr."""
    print(f"vig: {in_one_line(words)}", file=sys.stderr, flush=True)


def end(folder: Path, words: str, result: Mapping[str, Any] | None = None, lines: Iterable[Any] = ()) -> None:
    """End a command: print lines and its output folder, then on stderr a summary and the next steps.

    With the result that --json asks for print that alone, and the folder, as one JSON object.
    """
    if result is not None:
        print(json.dumps({**result, "folder": str(folder)}, indent=2, default=os.fspath), flush=True)
        return
    print(*lines, folder, sep="\n", flush=True)
    note(words)


def in_one_line(words: str) -> str:
    """Return text with unprintable characters escaped: file names may hold line ends or undecodable bytes."""
    return "".join(letter if letter.isprintable() else repr(letter)[1:-1] for letter in words)
