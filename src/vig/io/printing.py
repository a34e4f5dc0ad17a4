"""The lines that commands print."""

import sys
from pathlib import Path


def note(words: str) -> None:
    """Print an error or a remark in one line on stderr."""
    print(f"vig: {in_one_line(words)}", file=sys.stderr, flush=True)


def end(folder: Path, words: str) -> None:
    """End a command: print its output folder, then on stderr a summary and the next steps."""
    print(folder, flush=True)
    note(words)


def in_one_line(words: str) -> str:
    """Return text with unprintable characters escaped: file names may hold line ends or undecodable bytes."""
    return "".join(letter if letter.isprintable() else repr(letter)[1:-1] for letter in words)
