"""run.json: a run's settings, its machine, which steps are complete and how long they took."""

import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Protocol

from vig import __version__
from vig.io.checks import decode, read_json, reading
from vig.io.errors import UserError
from vig.io.files import write_json

FORMAT_VERSION = 1


class RecordedSettings(Protocol):
    """Settings that must be the same when a run resumes."""

    def to_json(self) -> dict[str, Any]: ...


class Record:
    """The contents of run.json; every change is written at once.

    Attributes:
        path: Path of run.json.
        data: `{"vig_run", "vig", "command", "machine", "settings", "steps": {name: {"complete", "seconds",
            "sittings", "finished"}}}`; seconds of all sittings together, finished in UTC.
    """

    def __init__(self, path: Path, data: dict[str, Any]) -> None:
        self.path, self.data = path, data

    @staticmethod
    def open(path: Path, settings: RecordedSettings, machine: Mapping[str, Any], command: str) -> "Record":
        """Read the record at `path`, or begin one.

        Raises:
            UserError: The record is of other settings or damaged, or the folder holds other things.
        """
        requested = settings.to_json()
        if path.exists():
            record = Record(path, read_record(path))
            _refuse_other(path.parent, record.data["settings"], requested)
            return record
        if path.parent.exists() and not path.parent.is_dir():
            raise UserError(f"expected a folder for the run; '{path.parent}' is a file. Choose another name.")
        if path.parent.is_dir() and any(path.parent.iterdir()):
            raise UserError(
                f"expected a new folder, or one of a run with its {path.name}; '{path.parent}' holds other"
                " files. Choose another."
            )
        begun = {"vig_run": FORMAT_VERSION, "vig": __version__, "command": command}
        record = Record(path, begun | {"machine": dict(machine), "settings": requested, "steps": {}})
        record._save()
        return record

    def complete(self, step: str) -> bool:
        """Return whether a step has been completed."""
        return bool(self._step(step)["complete"])

    def seconds(self, step: str) -> float:
        """Return how long a step has taken so far, in all sittings."""
        return float(self._step(step)["seconds"])

    def forget(self, steps: list[str]) -> None:
        """Mark steps as not complete, since their inputs are made again."""
        for step in steps:
            if step in self.data["steps"]:
                self.data["steps"][step]["complete"] = False
        self._save()

    def renew(self, settings: RecordedSettings, steps: list[str]) -> None:
        """Go on with other settings, `steps` being as if never begun."""
        self.data["settings"] = settings.to_json()
        for step in steps:
            self.data["steps"].pop(step, None)
        self._save()

    @contextmanager
    def time_step(self, step: str) -> Iterator[None]:
        """Count a block's time as the step's; the step is complete when the block raises nothing."""
        entry, started = self._step(step), time.monotonic()
        self.data["steps"][step] = entry
        try:
            yield
            entry |= {"complete": True, "finished": datetime.now(UTC).isoformat(timespec="seconds")}
        finally:
            entry["seconds"] = round(entry["seconds"] + time.monotonic() - started, 1)
            entry["sittings"] += 1
            self._save()

    def _step(self, step: str) -> dict[str, Any]:
        fresh = {"complete": False, "seconds": 0.0, "sittings": 0, "finished": None}
        return self.data["steps"].get(step, fresh)

    def _save(self) -> None:
        write_json(self.path, self.data)


def read_record(path: Path) -> dict[str, Any]:
    """Read run.json. Raises UserError when it is missing, damaged, or of another format."""
    with reading(path, "the record of a run", "Choose another folder."):
        data: dict[str, Any] = decode(dict[str, Any], read_json(path))
        version, is_complete = (
            data["vig_run"],
            {"vig", "command", "machine", "settings", "steps"} <= data.keys(),
        )
        if version == FORMAT_VERSION and is_complete:
            decode(dict[str, Any], data["settings"])
            for step in decode(dict[str, dict[str, Any]], data["steps"]).values():
                for name, kind in {"complete": bool, "seconds": float, "sittings": int}.items():
                    decode(kind, step[name])
    if version != FORMAT_VERSION or not is_complete:
        raise UserError(f"'{path}' is of another version of vig, or damaged; choose another folder.")
    return data


def _refuse_other(folder: Path, recorded: dict[str, Any], requested: dict[str, Any]) -> None:
    """Raise UserError that names the first setting in which two runs differ."""
    for name in requested | recorded:
        if recorded.get(name) != requested.get(name):
            old, new = (_text(settings.get(name)) for settings in (recorded, requested))
            raise UserError(
                f"'{folder}' holds a run with {name.replace('_', ' ')} {old}; {new} was asked for."
                " Choose another folder or the same settings."
            )


def _text(value: Any) -> str:
    return " ".join(value) if isinstance(value, list) else "none" if value is None else str(value)
