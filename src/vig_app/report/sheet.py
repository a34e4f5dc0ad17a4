"""sheet.jpg: the photos of a run on one picture, what is strangest first."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from PIL import Image, ImageDraw, ImageFont

from vig.io.files import atomic_write
from vig_app.report.folder_page import THUMBNAIL_FILE, review_order
from vig_app.report.html import QUALITY

TILE, BORDER, LABEL, GAP = 160, 4, 34, 6
"""Pixels: a picture's side, its frame in the verdict's colour, the two lines under it, between tiles."""
COLUMNS = 16
PER_SHEET = 200
MOST_SHEETS = 5
COLOURS = {
    "trusted": (45, 164, 78),
    "ambiguous": (191, 135, 0),
    "reverted": (207, 34, 46),
    "failed": (207, 34, 46),
    "absent": (110, 119, 129),
    "error": (110, 119, 129),
}
GROUND, TEXT, QUIET = (255, 255, 255), (27, 31, 36), (138, 144, 153)
LETTERS = 26
"""Of a tile's line."""


def sheet_name(number: int) -> str:
    """sheet.jpg, then sheet-2.jpg and so on."""
    return "sheet.jpg" if number == 0 else f"sheet-{number + 1}.jpg"


def write_sheets(out: Path, rows: Sequence[Mapping[str, Any]]) -> list[Path]:
    """Write the photos of a run in the order of `review_order`, `PER_SHEET` to a sheet.

    Args:
        out: Folder of the run, which holds that of each photo.
        rows: Of the photos, see `vig_app.runs.run`.

    Returns:
        The files, `MOST_SHEETS` at most; further ones of an earlier run are removed.

    Raises:
        UserError: They cannot be written.
    """
    ordered = sorted(rows, key=review_order)
    written = []
    for number in range(MOST_SHEETS):
        path, part = out / sheet_name(number), ordered[number * PER_SHEET : (number + 1) * PER_SHEET]
        if part:
            with atomic_write(path) as temporary:
                _sheet(out, part).save(temporary, "JPEG", quality=QUALITY)
            written.append(path)
        elif path.is_file():
            path.unlink()
    return written


def _sheet(out: Path, rows: Sequence[Mapping[str, Any]]) -> Image.Image:
    columns = min(COLUMNS, math.ceil(math.sqrt(1.5 * len(rows))))
    wide, high = TILE + 2 * BORDER + GAP, TILE + 2 * BORDER + LABEL + GAP
    lines = math.ceil(len(rows) / columns)
    sheet = Image.new("RGB", (columns * wide + GAP, lines * high + GAP), GROUND)
    for number, row in enumerate(rows):
        place = GAP + number % columns * wide, GAP + number // columns * high
        sheet.paste(_tile(out, row), place)
    return sheet


def _tile(out: Path, row: Mapping[str, Any]) -> Image.Image:
    """A photo in a frame of its verdict's colour, under it its name and how sure it is."""
    verdict = "error" if row["error"] is not None else row["verdict"]
    side = TILE + 2 * BORDER
    tile = Image.new("RGB", (side, side + LABEL), GROUND)
    pen, font = ImageDraw.Draw(tile), ImageFont.load_default(11)
    pen.rectangle((0, 0, side - 1, side - 1), fill=COLOURS[verdict])
    pen.rectangle((BORDER, BORDER, side - BORDER - 1, side - BORDER - 1), fill=QUIET)
    try:
        with Image.open(out / row["folder"] / THUMBNAIL_FILE) as picture:
            picture.thumbnail((TILE, TILE))
            tile.paste(picture, ((side - picture.width) // 2, (side - picture.height) // 2))
    except OSError:  # none was made, or it is gone
        told = _shown(row["error"] or "without a picture").removeprefix(f"{_shown(row['photo'])}: ")
        lines = textwrap.wrap(told, LETTERS)[: TILE // 14]
        pen.multiline_text((BORDER + 4, BORDER + 4), "\n".join(lines), fill=GROUND, font=font, spacing=2)
    which = row["folder"].partition("/")[2]  # of several objects
    name = _shown(f"{Path(row['photo']).name} {which}".rstrip())
    if len(name) > LETTERS:
        name = f"{name[: LETTERS // 2 - 1]}...{name[2 - LETTERS // 2 :]}"
    sure = row["confidence"]
    pen.text((2, side + 2), name, fill=TEXT, font=font)
    words = verdict if sure is None else f"{verdict}, right with {sure:.0%}"
    pen.text((2, side + 17), words, fill=COLOURS[verdict], font=font)
    return tile


def _shown(text: str) -> str:
    """Text as the font has it: what is not printable is replaced."""
    return "".join(each if each.isprintable() else "?" for each in text)
