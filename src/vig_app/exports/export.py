"""Writes explanations and runs in any of the formats, and removes what was written."""

from __future__ import annotations

from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING

from vig.io.errors import UserError
from vig_app.exports.run import ExportedRun

if TYPE_CHECKING:
    from vig.explanation import Explanation


def _names_in(package: str) -> tuple[str, ...]:
    """Names of the modules of a subpackage, which are not imported: help on the command line lists them."""
    files = (Path(__file__).parent / package).glob("*.py")
    return tuple(sorted(path.stem for path in files if path.stem != "__init__"))


FORMATS = _names_in("formats")
"""Of an explanation."""
RUN_FORMATS = _names_in("run_formats")
"""Of a run over many photos."""


def export_explanation(
    explanation: Explanation, folder: str | Path, formats: Sequence[str], photo: str
) -> Path:
    """The work of `Explanation.export`."""
    _check(formats, FORMATS)
    for name in formats:
        _module("formats", name).write(Path(folder), explanation, photo)
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
    _check(formats, RUN_FORMATS)
    run = ExportedRun.read(Path(results), first_id)
    paths = []
    for name in formats:
        module = _module("run_formats", name)
        paths.append(Path(out or results) / module.FILE)
        module.write(paths[-1], run)
    return paths


def remove_exports(folder: Path) -> None:
    """Remove the exports of an earlier explanation, and folders that held nothing else."""
    for file in (file for name in FORMATS for file in _module("formats", name).FILES):
        path = folder / file
        path.unlink(missing_ok=True)
        for parent in path.parents:
            if parent == folder or not parent.is_dir() or any(parent.iterdir()):
                break
            parent.rmdir()


def formats_in(folder: Path) -> tuple[str, ...]:
    """Formats of the exports of an explanation that a folder holds."""
    return tuple(
        name for name in FORMATS if any((folder / file).exists() for file in _module("formats", name).FILES)
    )


def run_formats_in(folder: Path) -> tuple[str, ...]:
    """Formats of the exports of a run that a folder holds."""
    return tuple(name for name in RUN_FORMATS if (folder / _module("run_formats", name).FILE).exists())


def run_files() -> tuple[str, ...]:
    """Names of all files that `export_run` may write."""
    return tuple(_module("run_formats", name).FILE for name in RUN_FORMATS)


def _check(formats: Sequence[str], known: Sequence[str]) -> None:
    """UserError for a text in place of a list, or what is no format."""
    wrong = [formats] if isinstance(formats, str) else [name for name in formats if name not in known]
    if wrong:
        options = ", ".join(known)
        raise UserError(f"expected a list of formats out of {options}; got '{wrong[0]}'. Name these.")


def _module(package: str, name: str) -> ModuleType:
    return import_module(f"vig_app.exports.{package}.{name}")
