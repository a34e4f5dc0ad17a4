"""The files of a user's folder, and the fingerprints by which a dataset identifies them."""

import hashlib
import os
from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import NoReturn

from vig.io.errors import UserError
from vig.io.files import compose_name
from vig.io.printing import in_one_line


def files_of(
    folder: str | Path, suffixes: tuple[str, ...], also: tuple[str, ...] = ()
) -> list[tuple[str, Path]]:
    """List the files below a folder with one of the suffixes, except hidden ones; links are followed.

    Args:
        folder: Folder to search.
        suffixes: Suffixes of the files, in lower case.
        also: Suffixes of others that are listed, where there is a file with one of `suffixes`.

    Returns:
        Names relative to the folder with `/` between, in alphabetical order, and paths. Characters in names
        are composed (NFC), and escaped where they cannot be printed. A link to a missing file is listed:
        reading it reports the error.

    Raises:
        UserError: When the folder is missing, is a file, or holds no such file.
    """
    root = Path(folder)
    kinds = " ".join(suffixes)
    if not root.is_dir():
        came = "a file" if root.exists() else "nothing of that name"
        raise UserError(f"{root}: expected a folder of files {kinds}; got {came}. Check the path.")
    there = {path.relative_to(root).as_posix(): path for path in _walk(root)}
    named: dict[str, Path] = {}
    for name in sorted(there, key=lambda name: (compose_name(name) != name, name)):
        if there[name].suffix.lower() in suffixes + also:
            shown = in_one_line(compose_name(name))
            named[name if shown in named else shown] = there[name]
    if not any(path.suffix.lower() in suffixes for path in named.values()):
        others = Counter(path.suffix.lower() for path in there.values() if path.suffix).most_common(5)
        came = ", ".join(f"{count} {suffix}" for suffix, count in others)
        raise UserError(
            f"{root}: expected files {kinds}; got {came or 'none'}. Convert them, or check the path."
        )
    return sorted(named.items())


def _walk(root: Path) -> Iterator[Path]:
    """Yield the files below a folder but hidden ones; of a folder that links lead to again, once."""
    pending, seen = [str(root)], set[str]()
    while pending:
        linked = []
        for folder, folders, files in os.walk(pending.pop(0), onerror=_refuse_unlisted):
            place = os.path.realpath(folder)
            if place in seen:
                folders.clear()
                continue
            seen.add(place)
            folders[:] = sorted(name for name in folders if not name.startswith("."))
            paths = [os.path.join(folder, name) for name in folders]
            linked += [path for path in paths if os.path.islink(path)]
            for name in files:
                path = Path(folder, name)
                if not name.startswith(".") and (path.is_file() or path.is_symlink()):
                    yield path
        pending += linked


def _refuse_unlisted(error: OSError) -> NoReturn:
    raise UserError(
        f"{error.filename}: cannot be listed ({error.strerror}). Check its permissions."
    ) from error


def fingerprint(files: Mapping[str, bytes | Path]) -> str:
    """Return sha256 (64 hexadecimal digits) of files by name, given as bytes or as paths to read."""
    total = hashlib.sha256()
    for name in sorted(files):
        content = files[name]
        if isinstance(content, Path):
            with content.open("rb") as file:
                digest = hashlib.file_digest(file, "sha256")
        else:
            digest = hashlib.sha256(content)
        total.update(f"{name}\0{digest.hexdigest()}\n".encode(errors="surrogateescape"))
    return total.hexdigest()
