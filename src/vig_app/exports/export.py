"""Writes explanations and runs in any of the formats, and removes written files."""

from collections.abc import Sequence
from functools import cache
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING

from vig.io.errors import UserError

if TYPE_CHECKING:
    from vig.explanation import Explanation

_FILES = (Path(__file__).parent / "formats").glob("*.py")
FORMATS = tuple(sorted(path.stem.replace("_", "-") for path in _FILES if path.stem != "__init__"))
"""Names of the formats, which are not imported: help on the command line lists them."""


@cache
def run_formats() -> dict[str, tuple[str, ...]]:
    """Return the formats that have files for all photos of a run, and the patterns of their names."""
    files = {name: getattr(_module(name), "RUN_FILES", ()) for name in FORMATS}
    files |= {name: _module(name).FILES for name in FORMATS if hasattr(_module(name), "write_photos")}
    return {name: patterns for name, patterns in files.items() if patterns}


def export_explanation(
    explanation: "Explanation", folder: str | Path, formats: Sequence[str], photo: str
) -> Path:
    """Write the files of `Explanation.export`; of an absent object no pose, scene or model."""
    _check(formats)
    for name in formats:
        if not hasattr(_module(name), "write_photos") and str(explanation.verdict) == "absent":
            _remove(Path(folder), name, _module(name).FILES)
        elif hasattr(_module(name), "write_photos"):
            from vig_app.exports.annotations import one_photo  # help lists formats, and needs no results

            _module(name).write_photos(Path(folder), *one_photo(explanation, photo))
        else:
            _module(name).write(Path(folder), explanation)
    return Path(folder)


def export_run(
    results: str | Path, formats: Sequence[str], out: str | Path | None = None, first_id: int = 1
) -> list[Path]:
    """Write the results of many photos as files for all of them in each format, docs/many.md; returns them.

    Args:
        results: Folder of `vig fit` of several photos.
        formats: Any of those of `run_formats`.
        out: Folder for the files; by default that of the results.
        first_id: Number of the class in the dataset; where there are several classes that of the first by
            name, the others follow.

    Raises:
        UserError: There is no such format, the results cannot be read or a file not be written.
    """
    _check(formats)
    for name in formats:
        if name not in run_formats():
            raise UserError(
                f"expected a format with files for all photos, {', '.join(run_formats())}; got '{name}',"
                f" which has files for each. Write them with vig fit --export {name}."
            )
    from vig_app.exports.annotations import ExportedRun, photos_of  # help lists formats, and needs no results

    run, folder = ExportedRun.read(Path(results), first_id), Path(out or results)
    for name in formats:
        if hasattr(_module(name), "write_photos"):
            _module(name).write_photos(folder, photos_of(run), run.class_ids)
        else:
            _module(name).write_run(folder, run)
    return [path for name in formats for file in run_formats()[name] for path in sorted(folder.glob(file))]


def remove_exports(folder: Path, of_run: bool = False) -> None:
    """Remove the exports of an earlier explanation, or run, and folders that held nothing else."""
    for name in FORMATS:
        _remove(folder, name, run_formats().get(name, ()) if of_run else _module(name).FILES)


def _remove(folder: Path, name: str, files: Sequence[str]) -> None:
    """Remove files of a format, but for those that were edited, and folders that held nothing else."""
    for path in (path for file in files for path in folder.glob(file)):
        if hasattr(_module(name), "is_edited") and _module(name).is_edited(path):
            continue
        path.unlink()
        for parent in path.parents:
            if parent == folder or any(parent.iterdir()):
                break
            parent.rmdir()


def formats_in(folder: Path, of_run: bool = False) -> tuple[str, ...]:
    """Return the formats of the exports of an explanation, or of a run, that a folder holds."""
    files = run_formats() if of_run else {name: _module(name).FILES for name in FORMATS}
    return tuple(name for name, each in files.items() if any(any(folder.glob(file)) for file in each))


def _check(formats: Sequence[str]) -> None:
    """Raise UserError for a text in place of a list, or an unknown format."""
    wrong = [formats] if isinstance(formats, str) else [name for name in formats if name not in FORMATS]
    if wrong:
        raise UserError(
            f"expected a list of formats out of {', '.join(FORMATS)}; got '{wrong[0]}'. Name these."
        )


def _module(name: str) -> ModuleType:
    return import_module(f"vig_app.exports.formats.{name.replace('-', '_')}")
