"""The files of a user's folder, and the fingerprints by which a dataset identifies them."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from pathlib import Path

from vig.io.errors import UserError


def files_of(folder: str | Path, suffixes: tuple[str, ...]) -> list[tuple[str, Path]]:
    """List the files below a folder with one of the suffixes, except hidden ones.

    Returns:
        Names relative to the folder with `/` between, in their alphabetical order, and paths.

    Raises:
        UserError: When the folder is missing, is a file, or holds no such file.
    """
    root = Path(folder)
    kinds = " ".join(suffixes)
    if not root.is_dir():
        came = "a file" if root.exists() else "nothing of that name"
        raise UserError(f"{root}: expected a folder of files {kinds}; got {came}. Check the path.")
    try:
        files = [
            (path.relative_to(root).as_posix(), path)
            for path in root.rglob("*")
            if path.suffix.lower() in suffixes and path.is_file()
        ]
    except OSError as error:
        raise UserError(f"{root}: cannot be listed ({error.strerror}). Check its permissions.") from error
    files = [(name, path) for name, path in files if not any(p.startswith(".") for p in name.split("/"))]
    if not files:
        raise UserError(f"{root}: expected files {kinds}; got none. Check the path.")
    return sorted(files)


def fingerprint(files: Mapping[str, bytes | Path]) -> str:
    """sha256 (64 hexadecimal digits) of files by name, given as bytes or as paths to read."""
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
