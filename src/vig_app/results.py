"""The table of a run, and that of a track: written and read."""

from __future__ import annotations

import csv
import io
import json
import re
import tempfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, suppress
from itertools import islice
from pathlib import Path, PurePath
from typing import Any

from vig.io.checks import reading
from vig.io.files import atomic_write

TABLE = "results"
TABLES = (f"{TABLE}.csv", f"{TABLE}.parquet")
COLUMNS = (
    "photo", "folder", "object", "class", "error", "verdict", "view_trusted", "mask_trusted", "confidence",
    "mask_confidence", "azimuth_deg", "elevation_deg", "roll_deg", "azimuth_deviation_deg",
    "elevation_deviation_deg", "hidden_fraction", "family", "albedo_r", "albedo_g", "albedo_b", "box_x",
    "box_y", "box_width", "box_height", "width", "height", "focal_px", "focal_y_px", "center_x", "center_y",
    "focal_from", "distance_known",
    *(POSE := [f"camera_from_object_{row}{column}" for row in range(3) for column in range(4)]), "reason",
    "seconds",
)  # fmt: skip
"""Of the table; docs/many.md describes them."""
TRACK = "track"
TRACK_COLUMNS = (
    "photo", "folder", "frame", "lost", "refitted", "alone_azimuth_deg", "azimuth_deg",
    "azimuth_deviation_deg", "alone_elevation_deg", "elevation_deg", "elevation_deviation_deg", "roll_deg",
    "hidden_fraction", "focal_px", "center_x", "center_y", *POSE,
)  # fmt: skip
"""Of the table of a track, likewise."""

VERDICTS = ("failed", "absent", "reverted", "ambiguous", "trusted")
"""In the order in which photos are to be looked at."""
TEXTS = {"photo", "folder", "class", "error", "verdict", "family", "focal_from", "reason"}
TRUTHS = {"view_trusted", "mask_trusted", "distance_known", "lost", "refitted"}
"""Columns of text and of truth values; all others hold numbers."""
FORMULA = re.compile("'*[=+\\-@\t\r\n\uff1d\uff0b\uff0d\uff20]")
"""Beginning of texts that spreadsheets would compute; a quote before it makes them texts."""
WHOLE = {"object", "box_x", "box_y", "box_width", "box_height", "width", "height"}
"""Columns of whole numbers."""
GROUP = 4096
"""Rows of a table that are written at once."""


def name_of(row: Mapping[str, Any]) -> str:
    """The photo's name, and which of its objects a row is of where it has several."""
    _, several, which = row["folder"].partition("/")
    return PurePath(row["photo"]).name + (f" {which}" if several else "")


class RowsOnDisk:
    """Rows of a run in a temporary file, so that memory hardly grows with the photos.

    Iterating gives them in the order of the photos, any number of times; its length is how many photos have
    rows. What cannot be written stays in memory.

    Args:
        folders: Names of the photos' folders, in order.
    """

    def __init__(self, folders: Iterable[str]):
        self._places: dict[str, dict[str, int | bytes]] = {folder: {} for folder in folders}
        self._length = self._end = 0
        self._file: Any = None
        with suppress(OSError):
            self._file = tempfile.TemporaryFile(buffering=0)

    def add(self, row: Mapping[str, Any]) -> None:
        """Add an object's row, in the place of the one of its folder where there is one."""
        line, place = json.dumps(row).encode() + b"\n", self._end
        written = False
        with suppress(OSError, AttributeError):
            self._file.seek(place)
            written = self._file.write(line) == len(line)
        self._end += len(line) * written
        rows = self._places[row["folder"].split("/")[0]]
        self._length += not rows
        rows[row["folder"]] = place if written else line

    def __len__(self) -> int:
        return self._length

    def __iter__(self) -> Iterator[dict[str, Any]]:
        reader = None if self._file is None else io.BufferedReader(self._file)
        try:
            for place in [place for rows in self._places.values() for place in rows.values()]:
                if isinstance(place, bytes):
                    yield json.loads(place)
                elif reader is not None:
                    reader.seek(place)
                    yield json.loads(reader.readline())
        finally:
            if reader is not None:
                reader.detach()


def write_table(
    out: Path, rows: Iterable[dict[str, Any]], table: str = TABLE, columns: Sequence[str] = COLUMNS
) -> list[Path]:
    """Write results.csv, and results.parquet where pyarrow is installed; returns what was written.

    The rows are taken one after the other, `GROUP` of them are held at a time.
    """
    paths = [out / f"{table}.csv"]
    with ExitStack() as stack:
        temporary = stack.enter_context(atomic_write(paths[0]))
        file = stack.enter_context(open(temporary, "w", newline="", encoding="utf-8", errors="replace"))
        write_group = None
        with suppress(ImportError):
            import pyarrow
            from pyarrow import parquet

            schema = pyarrow.schema([(name, _kind(name)) for name in columns])
            paths.append(out / f"{table}.parquet")
            temporary = stack.enter_context(atomic_write(paths[1]))
            write_group = stack.enter_context(parquet.ParquetWriter(temporary, schema)).write_table
        writer = csv.DictWriter(file, columns, extrasaction="ignore")
        writer.writeheader()
        rows = iter(rows)
        while group := list(islice(rows, GROUP)):
            writer.writerows({name: _cell(value) for name, value in row.items()} for row in group)
            if write_group is not None:
                arrays = {name: [_text(row.get(name)) for row in group] for name in columns}
                write_group(pyarrow.table(arrays, schema))
    return paths


def read_results(folder: str | Path) -> list[dict[str, Any]]:
    """The rows of results.csv with numbers, truth values and None, as `pandas.DataFrame` takes them.

    Args:
        folder: That of `vig fit` of several photos.

    Raises:
        UserError: There is no such table, or it is damaged.
    """
    path = Path(folder) / TABLES[0]
    with reading(path, "the table of `vig fit` of several photos", "Name the folder of its results."):
        with open(path, encoding="utf-8", newline="") as file:
            rows = list(csv.DictReader(file))
        return [checked_row({name: _value(name, row[name]) for name in COLUMNS}) for row in rows]


def checked_row(row: dict[str, Any]) -> dict[str, Any]:
    """A row whose photo and folder are named, the folder within the run, and whose values are of their types;
    ValueError for others.
    """
    for name in COLUMNS:
        value, kinds = row.get(name), str if name in TEXTS else (int, float)
        if value is not None and (
            not isinstance(value, kinds) or isinstance(value, bool) != (name in TRUTHS)
        ):
            raise ValueError(f"the {name} {value!r}")
    folder = PurePath(row["folder"] or "")
    if not folder.parts or folder.is_absolute() or ".." in folder.parts:
        raise ValueError(f"the folder {row['folder']!r}, which is not within the run")
    if row["photo"] is None or (row["error"] is None and row["verdict"] not in VERDICTS):
        raise ValueError(f"{row['folder']!r} with the photo {row['photo']!r}, verdict {row['verdict']!r}")
    return row


def _value(name: str, text: str) -> Any:
    """What a cell of results.csv stands for."""
    if text == "" or name in TEXTS:
        return (text[1:] if text.startswith("'") and FORMULA.match(text) else text) or None
    if name in TRUTHS:
        return text == "True"
    return int(float(text)) if name in WHOLE else float(text)


def _cell(value: Any) -> Any:
    """A cell of results.csv, of which no spreadsheet makes a formula."""
    return f"'{value}" if isinstance(value, str) and FORMULA.match(value) else value


def _text(value: Any) -> Any:
    """Text as UTF-8 has it: file names may hold other bytes."""
    return value.encode("utf-8", "replace").decode() if isinstance(value, str) else value


def _kind(name: str) -> Any:
    """A column's type, the same whatever the rows are, so that tables of several runs can be joined."""
    import pyarrow

    if name in TEXTS:
        return pyarrow.string()
    return pyarrow.bool_() if name in TRUTHS else pyarrow.float64()
