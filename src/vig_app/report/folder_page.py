"""report.html of several photos, or objects of one: pictures and a table with links to their pages."""

import heapq
import os
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np
from PIL import Image

from vig.io.files import write_bytes
from vig.photo.outline import SMALLEST_PICTURE
from vig_app.report.html import fill_template, jpeg_bytes, write_page
from vig_app.results import VERDICTS, name_of

MAX_ENTRIES = 200  # photos on a run's page, at most
MAX_ERRORS = 200  # photos that are listed as not explained
WHOLE = 1200  # pixels of the longer side of the picture of several objects, at most
THUMBNAIL_FILE = "thumbnail.jpg"
COLUMNS = {
    "verdict": "verdict", "azimuth": "azimuth_deg", "elevation": "elevation_deg", "hidden": "hidden_fraction",
    "view right": "confidence", "mask right": "mask_confidence",
}  # fmt: skip
"""Columns of the table after the photo's name: heading, and its entry of `Entry.described`."""


@dataclass(frozen=True)
class Entry:
    """A photo, or an object, of the page.

    Attributes:
        name: Name of the photo or object.
        folder: Folder of its results, beside the page.
        described: Content of explanation.json or results.csv.
        picture: (H, W, 3) uint8.
        has_page: Whether report.html is among its files.
    """

    name: str
    folder: str
    described: Mapping[str, Any]
    picture: np.ndarray
    has_page: bool = True

    @property
    def link(self) -> str:
        """Return the address of its own page, or of its folder where it has none."""
        return quote(os.fsencode(self.folder)) + ("/report.html" if self.has_page else "/")


def folder_html(
    entries: Sequence[Entry],
    total: int | None = None,
    errors: Sequence[str] = (),
    title: str | None = None,
    picture: np.ndarray | None = None,
    note: str = "",
) -> str:
    """Return the page, in the order of `review_order`.

    Args:
        entries: The photos that are shown.
        total: Number of explained photos, if more than are shown.
        errors: Reasons why others were not; the first `MAX_ERRORS` are shown.
        title: Title in place of their number.
        picture: (H, W, 3) uint8, of all of them.
        note: Line under the title.
    """
    entries = sorted(entries, key=lambda entry: review_order(entry.described))
    total = len(entries) if total is None else total
    verdicts = Counter(entry.described["verdict"] for entry in entries)
    return fill_template(
        "folder.html",
        title=f"{total} photos explained" if title is None else title,
        counts=", ".join(f"{count} {verdict}" for verdict, count in verdicts.items()),
        note=note,
        total=total,
        entries=entries,
        errors=errors,
        most_errors=MAX_ERRORS,
        picture=None if picture is None else reduce_picture(picture, WHOLE),
        columns=COLUMNS,
        data=[[entry.name, *(entry.described[key] for key in COLUMNS.values())] for entry in entries],
    )


def write_run_page(out: Path, rows: Iterable[Mapping[str, Any]]) -> None:
    """Write report.html of a run: its first `MAX_ENTRIES` photos in review order. Takes the rows twice."""
    objects, photos, errors = 0, set[str](), []
    for row in rows:
        if row["error"] is None:
            objects += 1
            photos.add(row["photo"])
        else:
            errors.append(row["error"])
    entries = []
    for row in heapq.nsmallest(MAX_ENTRIES, (row for row in rows if row["error"] is None), review_order):
        folder = row["folder"].split("/")[0]  # the page of all for several objects
        picture = np.full((24, 32, 3), 128, np.uint8)  # where no thumbnail was asked for
        with suppress(Exception), Image.open(out / row["folder"] / THUMBNAIL_FILE) as thumbnail:
            picture = np.asarray(thumbnail)
        has_page = (out / folder / "report.html").exists()
        entries.append(Entry(name_of(row), folder, row, picture, has_page))
    if entries:
        title = None if len(photos) == objects else f"{len(photos)} photos, {objects} objects explained"
        write_page(out / "report.html", folder_html(entries, objects, errors, title))


def review_order(row: Mapping[str, Any]) -> tuple[int, float]:
    """Return the sort key of photos: errors, then `VERDICTS`; within each the least confidence first."""
    if row.get("error") is not None:
        return -1, 0.0
    return VERDICTS.index(row["verdict"]), row["confidence"] or 0.0


def reduce_picture(picture: np.ndarray, side: int = SMALLEST_PICTURE) -> np.ndarray:
    """Return a picture (H, W, 3) uint8 whose longer side has `side` pixels at most."""
    if max(picture.shape) <= side:
        return picture
    image = Image.fromarray(picture)
    image.thumbnail((side, side), Image.Resampling.BICUBIC, reducing_gap=2.0)
    return np.asarray(image)


def write_thumbnail(folder: Path, thumbnail: np.ndarray) -> None:
    """Write a picture (h, w, 3) uint8 of `SMALLEST_PICTURE` pixels that pages and sheets show."""
    write_bytes(folder / THUMBNAIL_FILE, jpeg_bytes(thumbnail))
