"""Entries of files by the names of photos."""

import os
import re
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from decimal import Decimal
from functools import cache
from itertools import count, product
from pathlib import Path
from typing import Any, TypeVar

from vig.io.errors import UserError
from vig.io.files import compose_name
from vig.io.printing import note

Value = TypeVar("Value")
NUMBERS = re.compile(r"(\d{9,}\.\d+|\d+)")
"""In names: whole ones, and Unix times, whose fractions have any number of digits."""
Parts = tuple[str, ...]  # the parts of a path


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
        why = f"are of {len(forms)} forms ({list_names(forms)})" if len(forms) > 1 else "have a number twice"
        note(f"frames taken in the order {list_names(frame.name for frame in frames)}; their names {why}")


def by_photo(
    entries: Mapping[str, Value], photos: Sequence[Path], what: str, path: Path
) -> dict[Path, Value]:
    """Return the entry of each photo that a file has one of.

    A photo is named by its file's name, or by the end of its path, in any Unicode composition. Entries of
    other photos are passed over with a line.

    Args:
        entries: By those names.
        photos: All of them.
        what: The entries are, such as "boxes".
        path: Path of the file.

    Raises:
        UserError: A name is that of several photos, or no entry is of any photo.
    """
    folders = cache(lambda folder: _parts(os.path.realpath(folder)))
    by_path = defaultdict[Parts, list[Path]](list)  # a photo may be given twice, in two ways
    for photo in photos:
        by_path[*folders(photo.parent), photo.name].append(photo)
    by_end = defaultdict[Parts, list[Parts]](list)
    for path_parts, depth in product(by_path, {len(_parts(name)) for name in entries} - {0}):
        by_end[tuple(map(compose_name, path_parts[-depth:]))].append(path_parts)
    matches: dict[Path, tuple[int, Value]] = {}  # with the length of the name: the longest counts
    others: list[str] = []
    for name, value in entries.items():
        end = _parts(name)
        paths = by_end.get(tuple(map(compose_name, end)), [])
        paths = [each for each in paths if each[-len(end) :] == end] or paths if len(paths) > 1 else paths
        if len(paths) > 1:
            depth = next(n for n in count(1) if len({each[-n:] for each in paths}) == len(paths))
            raise UserError(
                f"expected {what} in '{path}' that name one photo each; got '{name}', which is the name of"
                f" {len(paths)}. Name them by their folders too, such as '{'/'.join(paths[0][-depth:])}'."
            )
        others += [] if paths else [name]
        for photo in by_path[paths[0]] if paths else ():
            if photo not in matches or len(name) > matches[photo][0]:
                matches[photo] = len(name), value
    if not matches and entries:
        raise UserError(
            f"expected {what} of the {len(photos)} photos; got one of '{others[0]}' in '{path}'."
            " Use the photos' file names, or ends of their paths."
        )
    if others:
        noun = "photo" if len(others) == 1 else "photos"
        note(f"{what} of {len(others)} other {noun} passed over: {list_names(others)}")
    return {photo: value for photo, (_, value) in matches.items()}


def _parts(path: str) -> Parts:
    """Return the parts of a path with slashes or backslashes; an absolute one's begin with "" or a drive."""
    first, *others = path.replace("\\", "/").split("/")
    return (
        *((first,) if first != "." and (first or others) else ()),
        *(part for part in others if part not in ("", ".")),
    )


def list_names(names: Iterable[str]) -> str:
    """Return a few names in one line."""
    all_names = list(names)
    listed = 3  # names that a line lists at most
    return ", ".join(all_names[:listed]) + (", ..." if len(all_names) > listed else "")
