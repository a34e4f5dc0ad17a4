"""Entries of files by the names of photos."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from decimal import Decimal
from pathlib import Path, PurePath
from typing import Any, TypeVar

from vig.io.errors import UserError
from vig.io.printing import note

Value = TypeVar("Value")
NUMBERS = re.compile(r"(\d{9,}\.\d+|\d+)")
"""In names: whole ones, and Unix times, whose fractions have any number of digits."""
LISTED = 3
"""Names that a line lists at most."""


def in_order(paths: Iterable[Path]) -> list[Path]:
    """Sort files as people count: frame-9.png before frame-10.png."""

    def key(path: Path) -> tuple[list[Any], str]:
        parts = NUMBERS.split(str(path.with_suffix("")).casefold())  # text, number, text ...
        return [Decimal(part) if n % 2 else part for n, part in enumerate(parts)], str(path)

    return sorted(paths, key=key)


def note_order(frames: Sequence[Path]) -> None:
    """Print a line where names of frames may not give their order: several forms, a number twice."""
    forms = dict.fromkeys(NUMBERS.sub("#", frame.stem.casefold()) for frame in frames)
    numbers = {tuple(map(Decimal, NUMBERS.findall(frame.stem))) for frame in frames}
    if len(forms) > 1 or len(numbers) < len(frames):
        why = f"are of {len(forms)} forms ({listed(forms)})" if len(forms) > 1 else "have a number twice"
        note(f"frames taken in the order {listed(frame.name for frame in frames)}; their names {why}")


def by_photo(
    entries: Mapping[str, Value], photos: Sequence[Path], what: str, path: Path
) -> dict[Path, Value]:
    """The entry of each photo that a file has one of.

    A photo is named by its file's name, or by the end of its path. Entries of other photos are passed over
    with a line.

    Args:
        entries: By those names.
        photos: All of them.
        what: The entries are, such as "boxes".
        path: Of the file.

    Raises:
        UserError: A name is that of several photos, or no entry is of any photo.
    """
    matches: dict[Path, tuple[int, Value]] = {}  # with the length of the name: the longest counts
    others: list[str] = []
    ends = {photo: photo.resolve().parts for photo in photos}
    for name, value in entries.items():
        parts = tuple(part for part in PurePath(name.replace("\\", "/")).parts if part != ".")
        named = [photo for photo, end in ends.items() if end[-len(parts) :] == parts]
        if len({ends[photo] for photo in named}) > 1:
            paths = {ends[photo] for photo in named}
            depth = next(n for n in range(1, 99) if len({end[-n:] for end in paths}) == len(paths))
            example = "/".join(ends[named[0]][-depth:])
            raise UserError(
                f"expected {what} in '{path}' that name one photo each; got '{name}', which is the name of"
                f" {len(paths)}. Name them by their folders too, such as '{example}'."
            )
        others += [] if named else [name]
        for photo in named:
            if photo not in matches or len(parts) > matches[photo][0]:
                matches[photo] = len(parts), value
    if not matches and entries:
        raise UserError(
            f"expected {what} of the {len(photos)} photos; got one of '{others[0]}' in '{path}'."
            " Use the photos' file names, or ends of their paths."
        )
    if others:
        noun = "photo" if len(others) == 1 else "photos"
        note(f"{what} of {len(others)} other {noun} passed over: {listed(others)}")
    return {photo: value for photo, (_, value) in matches.items()}


def listed(names: Iterable[str]) -> str:
    """A few names in one line."""
    all_names = list(names)
    return ", ".join(all_names[:LISTED]) + (", ..." if len(all_names) > LISTED else "")
