"""The table of a run, and that of a track: written and read."""

import csv
import io
import json
import re
import tempfile
from collections.abc import Collection, Iterable, Iterator, Mapping
from contextlib import ExitStack, suppress
from functools import cache
from itertools import islice
from pathlib import Path, PurePath
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

import msgspec

from vig.io.checks import reading
from vig.io.files import atomic_write

TABLE = "results"
TABLES = (f"{TABLE}.csv", f"{TABLE}.parquet")
POSE = {
    f"camera_from_object_{row}{column}": f"pinhole.camera_from_object.{row}.{column}"
    for row in range(3)
    for column in range(4)
}
COLUMNS: dict[str, str | type] = {
    "photo": str,
    "folder": str,
    "object": int,
    "class": "class",
    "error": str,
    "verdict": "verdict",
    "view_trusted": "trusted.view",
    "mask_trusted": "trusted.mask",
    **{name: name for name in ("confidence", "mask_confidence", "azimuth_deg", "elevation_deg", "roll_deg")},
    "azimuth_deviation_deg": "deviation.azimuth_deg",
    "elevation_deviation_deg": "deviation.elevation_deg",
    "hidden_fraction": "hidden_fraction",
    "family": "family",
    **{f"albedo_{channel}": f"albedo.{place}" for place, channel in enumerate("rgb")},
    **{f"box_{side}": f"box.{place}" for place, side in enumerate(("x", "y", "width", "height"))},
    "width": "camera.width",
    "height": "camera.height",
    "focal_px": "pinhole.K.0.0",
    "focal_y_px": "pinhole.K.1.1",
    "center_x": "pinhole.K.0.2",
    "center_y": "pinhole.K.1.2",
    "focal_from": "camera.focal_from",
    "distance_known": "pinhole.distance_known",
    **POSE,
    "reason": "reason",
    "seconds": float,
}
"""Columns of the table: a value's place in explanation.json, or the type of one that is the run's;
docs/many.md describes them."""
TRACK = "track"
TRACK_COLUMNS: dict[str, str | type] = {
    "photo": str,
    "folder": str,
    "frame": int,
    "lost": bool,
    "refitted": bool,
    **dict.fromkeys(("alone_azimuth_deg", "azimuth_deg", "azimuth_deviation_deg"), float),
    **dict.fromkeys(("alone_elevation_deg", "elevation_deg", "elevation_deviation_deg"), float),
    "roll_deg": float,
    "hidden_fraction": float,
    **dict.fromkeys(("focal_px", "center_x", "center_y"), float),
    **dict.fromkeys(POSE, float),
}
"""Columns of the table of a track, the same way."""

VERDICTS = ("failed", "absent", "reverted", "ambiguous", "trusted")
"""Verdicts in the order in which photos are to be reviewed."""
FORMULA = re.compile("'*[=+\\-@\t\r\n\uff1d\uff0b\uff0d\uff20]")
"""Beginning of texts that spreadsheets would compute; a quote before it makes them texts."""
GROUP = 4096  # rows of a table that are written at once


def row_of_record(described: Mapping[str, Any], **of_run: Any) -> dict[str, Any]:
    """Return a row of the table from the content of explanation.json, and the run's fields of the photo."""
    row = {name: _at(described, place) if isinstance(place, str) else None for name, place in COLUMNS.items()}
    return row | of_run


def _at(value: Any, place: str) -> Any:
    """Return the value at a place of a record, None for nothing; for a list of words whether one is in it."""
    for step in place.split("."):
        if isinstance(value, list):
            value = value[int(step)] if step.isdecimal() else step in value
        elif value is not None:
            value = value[step]
    return value


@cache
def kind_of(column: str | type) -> type:
    """Return the type of a column's values, str, bool, int or float, as the record has it."""
    from vig.record import Explanation  # which loads the network's library: help would wait for it

    if isinstance(column, type):
        return column
    kind: Any = Explanation
    for step in column.split("."):
        if isinstance(kind, type) and issubclass(kind, msgspec.Struct):
            kind = {each.encode_name: each.type for each in msgspec.structs.fields(kind)}[step]
        else:
            kind = get_args(kind)[0] if step.isdecimal() else bool
        while get_origin(kind) in (Annotated, UnionType, Union):  # its type without bounds, or null
            kind = next(each for each in get_args(kind) if each is not NoneType)
    return str if get_origin(kind) is Literal else kind


def name_of(row: Mapping[str, Any]) -> str:
    """Return the photo's name, and which of its objects a row is of where it has several."""
    _, several, which = row["folder"].partition("/")
    return PurePath(row["photo"]).name + (f" {which}" if several else "")


def without_dismissed(rows: Collection[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return rows without those of objects marked as not there of photos that show others."""
    shown = {row["folder"].split("/")[0] for row in rows if row["verdict"] != "absent"}
    return [row for row in rows if row["verdict"] != "absent" or row["folder"].split("/")[0] not in shown]


class RowsOnDisk:
    """Rows of a run in a temporary file, so that memory hardly grows with the photos.

    Iterating gives them in the order of the photos, any number of times; its length is how many photos have
    rows. Unwritable rows stay in memory.

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
    out: Path, rows: Iterable[dict[str, Any]], table: str = TABLE, columns: Mapping[str, str | type] = COLUMNS
) -> list[Path]:
    """Write results.csv, and results.parquet where pyarrow is installed; returns the files.

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

            # The same whatever the rows are, so that tables of several runs can be joined.
            types = {str: pyarrow.string(), bool: pyarrow.bool_()}
            kinds = {name: kind_of(column) for name, column in columns.items()}
            schema = pyarrow.schema(
                [(name, types.get(kind, pyarrow.float64())) for name, kind in kinds.items()]
            )
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
    """Return the rows of results.csv with numbers, truth values and None, as `pandas.DataFrame` takes them.

    Args:
        folder: Folder of `vig fit` for several photos.

    Raises:
        UserError: There is no such table, or it is damaged.
    """
    path = Path(folder) / TABLES[0]
    with reading(path, "the table of `vig fit` of several photos", "Name the folder of its results."):
        with open(path, encoding="utf-8", newline="") as file:
            rows = list(csv.DictReader(file))
        return [
            check_row({name: _value(kind_of(column), row[name]) for name, column in COLUMNS.items()})
            for row in rows
        ]


def check_row(row: dict[str, Any]) -> dict[str, Any]:
    """Return a row whose photo and folder are named, the folder within the run, and whose values are of
    their types; ValueError for others.
    """
    for name, column in COLUMNS.items():
        value, kind = row.get(name), kind_of(column)
        kinds = (int, float) if kind in (int, float) else kind
        if value is not None and (not isinstance(value, kinds) or isinstance(value, bool) != (kind is bool)):
            raise ValueError(f"the {name} {value!r}")
    folder = PurePath(row["folder"] or "")
    if not folder.parts or folder.is_absolute() or ".." in folder.parts:
        raise ValueError(f"the folder {row['folder']!r}, which is not within the run")
    if row["photo"] is None or (row["error"] is None and row["verdict"] not in VERDICTS):
        raise ValueError(f"{row['folder']!r} with the photo {row['photo']!r}, verdict {row['verdict']!r}")
    return row


def _value(kind: type, text: str) -> Any:
    """Return the value that a cell of results.csv stands for."""
    if text == "" or kind is str:
        return (text[1:] if text.startswith("'") and FORMULA.match(text) else text) or None
    if kind is bool:
        return text == "True"
    return int(float(text)) if kind is int else float(text)


def _cell(value: Any) -> Any:
    """Return a cell of results.csv, of which no spreadsheet makes a formula."""
    return f"'{value}" if isinstance(value, str) and FORMULA.match(value) else value


def _text(value: Any) -> Any:
    """Return the text as UTF-8 has it: file names may hold other bytes."""
    return value.encode("utf-8", "replace").decode() if isinstance(value, str) else value
