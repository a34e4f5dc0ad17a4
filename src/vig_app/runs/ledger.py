"""The ledger of a run: its finished photos, with their keys and rows."""

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
from vig.known_object.keypoints import FILE as KEYPOINTS
from vig_app.results import check_row
from vig_app.runs.work import KEY, PARTIAL, Rows, RunSettings, Task

LEDGER = "results.jsonl"
FORMAT = 3


@contextmanager
def ledger_of(out: Path) -> Iterator[Any]:
    """Open results.jsonl, to be added to by this run alone.

    Where a run is refused before anything is done, the folder that was made for it is removed.
    """
    path, made = out / LEDGER, not out.exists()
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
        for unfinished in out.glob(f".*{PARTIAL}"):
            shutil.rmtree(unfinished, ignore_errors=True)
        try:
            yield file
        except UserError:
            if made and not path.stat().st_size and [*out.iterdir()] == [path]:
                shutil.rmtree(out)
            raise


def rows_done(ledger: Any) -> dict[str, tuple[str, Rows]]:
    """Return key and rows of photos that were explained, by their folders, the last of each; half a line,
    as after a kill, is completed.
    """
    ledger.seek(0)
    done: dict[str, tuple[str, Rows]] = {}
    line = "\n"
    for line in ledger:
        with suppress(ValueError, LookupError, TypeError, AttributeError):
            entry = json.loads(line)
            if all(check_row(row)["error"] is None for row in entry["rows"]):
                done[entry["rows"][0]["folder"].split("/")[0]] = str(entry["key"]), entry["rows"]
    if not line.endswith("\n"):
        ledger.write("\n")
    return done


def is_done(task: Task, key: str, rows: Rows) -> bool:
    """Return whether a photo's folder holds the results of its rows, whole, and those of a key."""
    try:
        complete = all((task.folder.parent / row["folder"] / "explanation.json").exists() for row in rows)
        return complete and (task.folder / KEY).read_text() == key
    except (OSError, ValueError):
        return False


def settings_key(settings: RunSettings, explainer: Explainer) -> str:
    """Return the key of everything that all photos' results depend on."""
    packs = [_pack_state(explainer.object_class.folder), *map(_pack_state, settings.others)]
    files = (sorted(settings.files or ()), settings.full_size) if settings.files or settings.full_size else ()
    return repr((FORMAT, __version__, settings.explain, sorted(settings.export), packs, *files))


def key_of(task: Task, settings: str) -> str:
    """Return the key of a row whose results are those of a photo, its hints and the `settings_key`."""
    options = task.box, task.focal, task.objects, task.most, task.camera
    packs = [_pack_state(name) for name in sorted({name for name, _ in task.objects})]
    digest = hashlib.sha256(repr((settings, _file_state(task.photo), options, packs)).encode())
    if task.corrected:
        digest.update(repr(task.corrected).encode())
    if task.labels:
        digest.update(repr(task.labels).encode())
    if task.mask is not None:
        digest.update(repr(_file_state(task.mask)).encode())
    if task.hints is not None:
        digest.update(repr(task.hints.to_plain()).encode())
        for array in (task.hints.mask, task.hints.marks):
            digest.update(b"" if array is None else array.tobytes())
    return digest.hexdigest()


def _pack_state(name: str | Path | None) -> Any:
    """Return a value that changes when a class pack does; the packaged classes change with the version."""
    folder = None if name is None else Path(name)
    files = folder.iterdir() if folder and folder.is_dir() else ()
    # Keypoints follow from the others, and are made when they are first needed.
    return str(name), sorted(_file_state(file) for file in files if file.name != KEYPOINTS)


def _file_state(path: Path) -> Any:
    """Return a value that changes when a file does."""
    try:
        stat = path.stat()
    except OSError:
        return str(path)
    return str(path.resolve()), stat.st_size, stat.st_mtime_ns
