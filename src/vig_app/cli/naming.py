"""What files say of photos by their names."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path, PurePath
from typing import TypeVar

from vig.io.errors import UserError

Value = TypeVar("Value")
SHOWN = 3
"""Names that a line lists."""


def by_photo(
    entries: Mapping[str, Value], photos: Sequence[Path], what: str, path: Path
) -> dict[Path, Value]:
    """What a file says of each photo, of those of which it says something.

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
    found: dict[Path, tuple[int, Value]] = {}
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
            if photo not in found or len(parts) > found[photo][0]:
                found[photo] = len(parts), value
    if not found and entries:
        raise UserError(
            f"expected {what} of the {len(photos)} photos; got one of '{others[0]}' in '{path}'."
            " Use the photos' file names, or ends of their paths."
        )
    if others:
        noun = "photo" if len(others) == 1 else "photos"
        note(f"{what} of {len(others)} other {noun} passed over: {listed(others)}")
    return {photo: value for photo, (_, value) in found.items()}


def listed(names: Iterable[str]) -> str:
    """A few names in one line."""
    all_names = list(names)
    return ", ".join(all_names[:SHOWN]) + (", ..." if len(all_names) > SHOWN else "")


def note(words: str) -> None:
    """Say something that is no error, in one line on stderr."""
    plain = "".join(each if each.isprintable() else repr(each)[1:-1] for each in words)
    print(f"vig: {plain}", file=sys.stderr, flush=True)
