"""Writes explanations and runs in any of the formats, and removes written files."""

from __future__ import annotations

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
FORMATS = tuple(sorted(path.stem for path in _FILES if path.stem != "__init__"))
"""Names of the formats, which are not imported: help on the command line lists them."""


@cache
def run_formats() -> dict[str, str]:
    """Return the formats that have one file for all photos of a run, and its name."""
    return {name: _module(name).RUN_FILE for name in FORMATS if hasattr(_module(name), "RUN_FILE")}


def export_explanation(
    explanation: Explanation, folder: str | Path, formats: Sequence[str], photo: str
) -> Path:
    """Write the files of `Explanation.export`."""
    _check(formats)
    for name in formats:
        _module(name).write(Path(folder), explanation, photo)
    return Path(folder)


def export_run(
    results: str | Path, formats: Sequence[str], out: str | Path | None = None, first_id: int = 1
) -> list[Path]:
    """Write the results of many photos as one file in each format, docs/many.md; returns the files.

    Args:
        results: Folder of `vig fit` of several photos.
        formats: Any of "bop" and "coco".
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
                f"expected a format with one file for all photos, {' or '.join(run_formats())}; got '{name}',"
                f" which has files for each. Write them with vig fit --export {name}."
            )
    from vig_app.exports.run import ExportedRun  # help lists formats, and needs no table

    run = ExportedRun.read(Path(results), first_id)
    paths = [Path(out or results) / run_formats()[name] for name in formats]
    for name, path in zip(formats, paths, strict=True):
        _module(name).write_run(path, run)
    return paths


def remove_exports(folder: Path) -> None:
    """Remove the exports of an earlier explanation, and folders that held nothing else."""
    for file in (file for name in FORMATS for file in _module(name).FILES):
        path = folder / file
        path.unlink(missing_ok=True)
        for parent in path.parents:
            if parent == folder or not parent.is_dir() or any(parent.iterdir()):
                break
            parent.rmdir()


def formats_in(folder: Path) -> tuple[str, ...]:
    """Return the formats of the exports of an explanation that a folder holds."""
    return tuple(name for name in FORMATS if any((folder / file).exists() for file in _module(name).FILES))


def _check(formats: Sequence[str]) -> None:
    """Raise UserError for a text in place of a list, or an unknown format."""
    wrong = [formats] if isinstance(formats, str) else [name for name in formats if name not in FORMATS]
    if wrong:
        raise UserError(
            f"expected a list of formats out of {', '.join(FORMATS)}; got '{wrong[0]}'. Name these."
        )


def _module(name: str) -> ModuleType:
    return import_module(f"vig_app.exports.formats.{name}")
