"""The ledger of a run: which photos are done, as what."""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from vig import __version__
from vig.explainer import Explainer
from vig.io.errors import UserError
from vig_app.runs.work import KEY, PARTIAL, Rows, RunSettings, Task

LEDGER = "results.jsonl"
FORMAT = 2


@contextmanager
def ledger_of(out: Path) -> Iterator[Any]:
    """results.jsonl, to be added to by this run alone."""
    path = out / LEDGER
    try:
        out.mkdir(parents=True, exist_ok=True)
        file = open(path, "a+", encoding="utf-8")
    except OSError as error:
        raise UserError(f"cannot write {path}: {error.strerror}; choose another --out.") from error
    with file:
        try:
            import fcntl

            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except ImportError:  # no such locks on this system
            pass
        except BlockingIOError:
            raise UserError(
                f"another run is writing to '{out}'; wait until it ends or choose another --out."
            ) from None
        except OSError as error:  # some network disks have none
            raise UserError(
                f"cannot lock {path}: {error.strerror}; choose an --out on a disk with file locks."
            ) from error
        for left in out.glob(f".*{PARTIAL}"):
            shutil.rmtree(left, ignore_errors=True)
        yield file


def rows_done(ledger: Any) -> dict[str, tuple[str, Rows]]:
    """Key and rows of photos that were explained, by their folders, the last of each; half a line, as a kill
    leaves it, is ended.
    """
    ledger.seek(0)
    found: dict[str, tuple[str, Rows]] = {}
    line = "\n"
    for line in ledger:
        with suppress(ValueError, LookupError, TypeError, AttributeError):
            told = json.loads(line)
            if all(row["error"] is None and isinstance(row["folder"], str) for row in told["rows"]):
                found[told["rows"][0]["folder"].split("/")[0]] = str(told["key"]), told["rows"]
    if not line.endswith("\n"):
        ledger.write("\n")
    return found


def is_done(task: Task, key: str, rows: Rows) -> bool:
    """Whether a photo's folder holds the results of its rows, whole, and those of a key."""
    try:
        there = all((task.folder.parent / row["folder"] / "explanation.json").exists() for row in rows)
        return there and (task.folder / KEY).read_text() == key
    except (OSError, ValueError):
        return False


def described(settings: RunSettings, explainer: Explainer) -> str:
    """What all photos' results depend on."""
    packs = [_pack(explainer.object_class.folder), *map(_pack, settings.others)]
    return repr((FORMAT, __version__, settings.explain, sorted(settings.export), packs))


def key_of(task: Task, said: str) -> str:
    """Tells whether a photo, its settings and what is said of it are those of a row."""
    about = task.box, task.focal, task.objects, task.most, task.camera
    packs = [_pack(name) for name in sorted({name for name, _ in task.objects})]
    digest = hashlib.sha256(repr((said, _stamp(task.photo), about, packs)).encode())
    if task.mask is not None:
        digest.update(repr(_stamp(task.mask)).encode())
    if task.hints is not None:
        digest.update(repr(task.hints.described()).encode())
        for array in (task.hints.mask, task.hints.marks):
            digest.update(b"" if array is None else array.tobytes())
    return digest.hexdigest()


def _pack(name: str | Path | None) -> Any:
    """What changes when a class pack does; the packaged classes change with the version."""
    folder = None if name is None else Path(name)
    return str(name), sorted(map(_stamp, folder.iterdir())) if folder and folder.is_dir() else []


def _stamp(path: Path) -> Any:
    """What changes when a file does."""
    try:
        stat = path.stat()
    except OSError:
        return str(path)
    return str(path.resolve()), stat.st_size, stat.st_mtime_ns
