"""Files that exist whole or not at all."""

import errno
import json
import os
import re
import secrets
import shutil
import unicodedata
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from safetensors import SafetensorError
from safetensors.numpy import save_file

from vig.io.errors import UserError

# Errors of the operating system for reasons that lie with the user's disk or path, not with vig.
_REMEDIES = {
    errno.ENOSPC: "the disk is full; free some space or choose another folder",
    errno.EDQUOT: "the disk quota is used up; free some space or choose another folder",
    errno.EFBIG: "the file is larger than this disk or account allows; choose another folder",
    errno.EACCES: "no permission to write there; choose another folder",
    errno.EPERM: "no permission to write there; choose another folder",
    errno.EROFS: "that disk is read-only; choose another folder",
    errno.ENOTDIR: "a part of the path is a file, not a folder; choose another path",
    errno.EEXIST: "a part of the path is a file, not a folder; choose another path",
    errno.EISDIR: "a folder of that name is in the way; choose another name",
    errno.ENAMETOOLONG: "the name is too long for this disk; choose a shorter one",
    errno.EIO: "the disk reports a failure; choose another one",
}

# The process's umask can only be read by setting it; done once, before there are threads.
_UMASK = os.umask(0o022)
os.umask(_UMASK)


def compose_name(name: str) -> str:
    """Return a file's name in Unicode's composed form (NFC), in which names are compared.

    Systems and tools store accents as one character with their letter, or as two.
    """
    return unicodedata.normalize("NFC", name)


def cache_folder() -> Path:
    """Return `vig` in the user's cache folder (`XDG_CACHE_HOME`, else `~/.cache`); it may not exist.

    Raises RuntimeError where there is no home folder.
    """
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "vig"


def as_stored(path: Path) -> Path:
    """Return the path in the Unicode composition that is there, if one is."""
    forms = (path, *(Path(unicodedata.normalize(form, str(path))) for form in ("NFC", "NFD")))
    return next((form for form in forms if os.path.lexists(form)), path)


@contextmanager
def atomic_write(path: str | Path) -> Iterator[Path]:
    """Yield a temporary path beside `path`; when the block ends well, rename it to `path`.

    The block writes one file at the temporary path, which has the same suffix. If the block raises, or
    Ctrl-C arrives, the temporary file is removed and the content of `path` stays. Missing parent folders
    are made. Readers never see half a file, even when the process is killed (a loss of power may lose the
    newest files: nothing waits for the disk).

    Raises UserError when the disk is full, read-only or forbidden, or when the path cannot be a file.
    """
    path = Path(path)
    temporary = path.with_name(f".{secrets.token_hex(6)}{path.suffix}")
    try:
        if path.is_dir():
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
        except FileNotFoundError as error:  # a file system that makes no folders, such as /proc
            raise UserError(f"cannot write {path}: no folder can be made there; choose another.") from error
        yield temporary
        os.chmod(temporary, 0o666 & ~_UMASK)  # some writers make files for their owner only
        os.replace(temporary, path)
    except OSError as error:
        raise _for_user(error, path) from error
    except SafetensorError as error:  # has the system's error in words alone
        number = re.search(r"os error (\d+)", str(error))
        raise _for_user(OSError(int(number[1]), str(error)), path) if number else error from error
    finally:
        if os.path.lexists(temporary):
            temporary.unlink()


def write_bytes(path: str | Path, data: bytes) -> None:
    """Write a file, whole or not at all; see `atomic_write`."""
    with atomic_write(path) as temporary:
        temporary.write_bytes(data)


def write_json(path: str | Path, described: Any, indent: int | None = 2) -> None:
    """Write a JSON file, whole or not at all; see `atomic_write`."""
    write_bytes(path, (json.dumps(described, indent=indent) + "\n").encode())


def write_arrays(
    path: str | Path, arrays: Mapping[str, np.ndarray], metadata: dict[str, str] | None = None
) -> None:
    """Write arrays by name as a safetensors file, whole or not at all; see `atomic_write`.

    The format's own writer takes memory as it lies: an array with moved axes would be read in another order.
    """
    with atomic_write(path) as temporary:
        save_file({name: np.ascontiguousarray(each) for name, each in arrays.items()}, temporary, metadata)


@contextmanager
def atomic_folder(path: str | Path) -> Iterator[Path]:
    """Yield an empty temporary folder beside `path`; when the block ends well, rename it to `path`.

    If the block raises, or Ctrl-C arrives, the temporary folder is removed. Where `path` is there by then,
    made by another process, that one stays. A killed process leaves a folder with a hidden name.

    Raises UserError like `atomic_write`.
    """
    path = Path(path)
    temporary = path.with_name(f".{secrets.token_hex(6)}")
    try:
        temporary.mkdir(parents=True)
        yield temporary
        try:
            os.replace(temporary, path)
        except OSError:
            if not path.is_dir():
                raise
    except OSError as error:
        raise _for_user(error, path) from error
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def _for_user(error: OSError, path: Path) -> OSError | UserError:
    """Return the error as the user's where the disk or the path is to blame, else itself."""
    remedy = _REMEDIES.get(error.errno or 0)
    return error if remedy is None else UserError(f"cannot write {path}: {remedy}.")
