"""sheet.jpg: the photos of a run on one picture, in review order, the least sure first."""

import heapq
import math
import textwrap
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from PIL import Image, ImageDraw, ImageFont

from vig.io.files import atomic_write
from vig_app.report.folder_page import THUMBNAIL_FILE, review_order
from vig_app.report.html import QUALITY
from vig_app.results import name_of

TILE = 160  # pixels of a picture's side in the sheets of a run
BORDER = 4  # pixels of its frame in the verdict's colour
LABEL = 34  # pixels of the two lines under it
GAP = 6  # pixels between tiles
PER_SHEET = 200  # photos
MAX_SHEETS = 5
VERDICT_COLOURS = {
    "trusted": (45, 164, 78),
    "ambiguous": (191, 135, 0),
    "reverted": (207, 34, 46),
    "failed": (207, 34, 46),
    "absent": (110, 119, 129),
    "error": (110, 119, 129),
}
BACKGROUND = (255, 255, 255)
TEXT = (27, 31, 36)


def sheet_name(number: int) -> str:
    """Return sheet.jpg, then sheet-2.jpg and so on."""
    return "sheet.jpg" if number == 0 else f"sheet-{number + 1}.jpg"


def write_sheets(
    out: Path, rows: Iterable[Mapping[str, Any]], tile: int = TILE, picture: str = THUMBNAIL_FILE
) -> list[Path]:
    """Write the photos of a run in the order of `review_order`, `PER_SHEET` to a sheet.

    Args:
        out: Folder of the run, which holds that of each photo.
        rows: Rows of the photos, see `vig_app.runs.run`.
        tile: Pixels of a picture's side.
        picture: File of each photo's folder that is shown.

    Returns:
        The files, `MAX_SHEETS` at most; further ones of an earlier run are removed.

    Raises:
        UserError: They cannot be written.
    """
    ordered = heapq.nsmallest(MAX_SHEETS * PER_SHEET, rows, review_order)
    written = []
    for number in range(MAX_SHEETS):
        path, part = out / sheet_name(number), ordered[number * PER_SHEET : (number + 1) * PER_SHEET]
        if part:
            with atomic_write(path) as temporary:
                columns = min(16, math.ceil(math.sqrt(1.5 * len(part))))
                lines, width = math.ceil(len(part) / columns), tile + 2 * BORDER + GAP
                height = width + LABEL
                sheet = Image.new("RGB", (columns * width + GAP, lines * height + GAP), BACKGROUND)
                for place, row in enumerate(part):
                    shown = _tile(row, out / row["folder"] / picture, tile)
                    sheet.paste(shown, (GAP + place % columns * width, GAP + place // columns * height))
                sheet.save(temporary, "JPEG", quality=QUALITY)
            written.append(path)
        elif path.is_file():
            path.unlink()
    return written


def _tile(row: Mapping[str, Any], path: Path, pixels: int) -> Image.Image:
    """Return a photo in a frame of its verdict's colour, under it its name and the confidence."""
    verdict = "error" if row["error"] is not None else row["verdict"]
    side = pixels + 2 * BORDER
    tile = Image.new("RGB", (side, side + LABEL), BACKGROUND)
    pen, font = ImageDraw.Draw(tile), ImageFont.load_default(11)
    pen.rectangle((0, 0, side - 1, side - 1), fill=VERDICT_COLOURS[verdict])
    pen.rectangle((BORDER, BORDER, side - BORDER - 1, side - BORDER - 1), fill=(138, 144, 153))
    letters = 26  # letters of a tile's line, at most
    try:
        with Image.open(path) as picture:
            picture.thumbnail((pixels, pixels))
            tile.paste(picture, ((side - picture.width) // 2, (side - picture.height) // 2))
    except Exception:  # none was made, it is gone, or damaged, of which a decoder may raise anything
        reason = _printable(row["error"] or "without a picture").removeprefix(f"{_printable(row['photo'])}: ")
        lines = textwrap.wrap(reason, letters)[: pixels // 14]
        pen.multiline_text((BORDER + 4, BORDER + 4), "\n".join(lines), fill=BACKGROUND, font=font, spacing=2)
    name = _printable(name_of(row))
    if len(name) > letters:
        name = f"{name[: letters // 2 - 1]}...{name[2 - letters // 2 :]}"
    confidence = row["confidence"]
    pen.text((2, side + 2), name, fill=TEXT, font=font)
    sure = confidence is not None and verdict != "absent"
    words = f"{verdict}, {confidence:.0%} likely right" if sure else verdict
    pen.text((2, side + 17), words, fill=VERDICT_COLOURS[verdict], font=font)
    return tile


def _printable(text: str) -> str:
    """Return the text as the font has it: unprintable characters are replaced."""
    return "".join(letter if letter.isprintable() else "?" for letter in text)
