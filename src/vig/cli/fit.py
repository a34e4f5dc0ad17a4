"""`vig fit`: photos explained, a folder each."""

from __future__ import annotations

import glob
import json
import os
import sys
from collections.abc import Sequence
from contextlib import suppress
from datetime import datetime
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from vig import __version__
from vig.checks import decode, read_json, reading
from vig.cli.common import Fit
from vig.cli.hints import hints_of, mask_of
from vig.errors import UserError
from vig.explainer import Box, checked_box
from vig.files import atomic_write
from vig.inference import ExplainSettings
from vig.likelihood import LIKELIHOODS
from vig.optimizers import OPTIMIZERS
from vig.report.page import THUMBNAIL_FILE, Entry, folder_html, strange_first
from vig.report.sheet import sheet_name, write_sheets
from vig.results import TABLES, write_table
from vig.runs import LEDGER, RunSettings, Task, run

MOST_ENTRIES = 200
"""Photos on a run's page, at most."""
TAKEN = {"report.html", sheet_name(0), LEDGER, *TABLES}
"""Names within a run's folder that no photo's folder may have."""
FRAMINGS = {"auto": None, "fixed": False, "free": True}


def fit(settings: Fit) -> int:
    """Explain every photo into a folder of its own; returns the exit code."""
    photos = photos_of(settings.images)
    boxes = boxes_of(settings, photos)
    hints, mask = hints_of(settings, photos), mask_of(settings, photos)
    folders = result_folders(photos, settings.out)
    how = ExplainSettings(
        LIKELIHOODS[settings.likelihood],
        self_shadow=not settings.no_self_shadow,
        free_framing=FRAMINGS[settings.framing],
        optimizer=OPTIMIZERS[settings.optimizer],
    )
    note = partial(add_line, settings.log)
    note(f"vig {__version__}: {len(photos)} photos into '{settings.out}'")
    given = RunSettings(settings.object_class, how, settings.device, settings.export)
    tasks = (
        Task(photo, folder, box, settings.focal, hints, mask(photo))
        for photo, folder, box in zip(photos, folders, boxes, strict=True)
    )
    rows: list[dict[str, Any]] = []
    try:
        for row in run(tasks, settings.out, given, settings.workers, len(photos) > 1, settings.cluster):
            rows.append(row)
            line = in_one_line(_line(row))
            note(line)
            if row["error"] is not None:
                print(f"vig: {in_one_line(row['error'])}", file=sys.stderr, flush=True)
            elif not settings.json and not settings.quiet:
                print(line, flush=True)
    finally:
        place = {str(photo): number for number, photo in enumerate(photos)}
        rows.sort(key=lambda row: place[row["photo"]])
        if len(photos) > 1 and rows:
            write_table(settings.out, rows)
            _write_page(settings.out, rows)
            write_sheets(settings.out, rows)
    failed = sum(row["error"] is not None for row in rows)
    if settings.json:
        print(json.dumps({"results": _results(rows, settings.out), "folder": str(settings.out)}, indent=2))
    elif failed < len(rows):
        if not settings.quiet:
            page = settings.out / ("" if len(photos) > 1 else folders[0].name) / "report.html"
            print(f"to look at: {page}")
        print(settings.out)
    return 0 if not failed else 1 if failed < len(rows) else 2


def _results(rows: list[dict[str, Any]], out: Path) -> dict[str, Any]:
    """What each explanation.json holds, by photo."""
    found = {}
    for row in rows:
        if row["error"] is None:
            folder = out / row["folder"]
            found[row["photo"]] = read_json(folder / "explanation.json") | {"folder": str(folder)}
    return found


def _write_page(out: Path, rows: list[dict[str, Any]]) -> None:
    """report.html of a run: the photos that are strangest, `MOST_ENTRIES` of them."""
    seen = sorted((row for row in rows if row["error"] is None), key=strange_first)
    entries = []
    for row in seen[:MOST_ENTRIES]:
        with suppress(OSError), Image.open(out / row["folder"] / THUMBNAIL_FILE) as picture:
            entries.append(Entry(Path(row["photo"]).name, row["folder"], row, np.asarray(picture)))
    if entries:
        errors = [row["error"] for row in rows if row["error"] is not None]
        with atomic_write(out / "report.html") as temporary:
            page = folder_html(entries, len(seen), errors)
            temporary.write_text(page, encoding="utf-8", errors="replace")


def in_one_line(words: str) -> str:
    """Text with what is not printable escaped: a file's name may hold line ends, or bytes of no encoding."""
    return "".join(each if each.isprintable() else repr(each)[1:-1] for each in words)


def add_line(log: Path | None, words: str) -> None:
    """Add a line with the time to a file, where there is one; UserError when it cannot be written."""
    if log is None:
        return
    try:
        with open(log, "a", encoding="utf-8", errors="replace") as file:
            print(datetime.now().isoformat(timespec="seconds"), words, file=file)
    except OSError as error:
        raise UserError(
            f"expected --log FILE that can be written; got '{log}' ({error.strerror}). Name another."
        ) from None


def photos_of(images: tuple[Path, ...]) -> list[Path]:
    """The photos that are named, and those in folders that are; UserError when there are none."""
    photos: list[Path] = []
    known = Image.registered_extensions()
    for image in (each for given in images for each in _expanded(given)):
        found = (
            [path for path in image.iterdir() if path.suffix.lower() in known] if image.is_dir() else [image]
        )
        if not found:
            raise UserError(f"expected photos in '{image}'; got none. Name others.")
        photos += sorted(found)
    if not photos:
        raise UserError("expected at least one photo, such as `vig fit photo.jpg`; got none.")
    return photos


def _expanded(given: Path) -> list[Path]:
    """Files of a pattern such as photos/*.jpg, which not every shell expands; any other path as it is."""
    pattern = str(given)
    if os.path.lexists(given) or not glob.has_magic(pattern):
        return [given]
    if found := sorted(glob.glob(pattern, recursive=True)):
        return [Path(each) for each in found]
    raise UserError(f"expected photos that match '{pattern}'; got none. Check the folder and the pattern.")


def boxes_of(settings: Fit, photos: list[Path]) -> list[Box | None]:
    """A box for each photo from `--box` or `--boxes`, None where neither names one."""
    if settings.boxes is None:
        return [None if settings.box is None else parse_box(settings.box)] * len(photos)
    if settings.box is not None:
        raise UserError("expected --box or --boxes; got both. Give one.")
    with reading(settings.boxes, "boxes by the photos' file names", 'Write {"photo.jpg": [x, y, w, h]}.'):
        named = decode(dict[str, tuple[float, float, float, float]], read_json(settings.boxes))
    if unknown := sorted(named.keys() - {photo.name for photo in photos}):
        raise UserError(
            f"expected boxes of the {len(photos)} photos; got one of '{unknown[0]}' in '{settings.boxes}'."
            " Use the photos' file names."
        )
    return [checked_box(named[photo.name]) if photo.name in named else None for photo in photos]


def parse_box(text: str) -> Box:
    """ "x,y,w,h" as four numbers; UserError when it is not."""
    try:
        return checked_box(text.replace(" ", "").split(","))
    except UserError:
        raise UserError(f"expected --box x,y,w,h in pixels, such as 40,30,200,160; got '{text}'") from None


def _line(row: dict[str, Any]) -> str:
    if row["error"] is not None:
        return f"error: {row['error']}"
    hidden, sure = row["hidden_fraction"], row["mask_confidence"]
    mask = "" if sure is None else f" (mask right with {sure:.0%})"
    seen = "nothing seen" if hidden is None else f"{hidden:.0%} hidden{mask}"
    colour = ", ".join(f"{row[f'albedo_{name}']:.2f}" for name in "rgb")
    when = "done before" if row.get("done_before") else f"{row['seconds']:.1f} s"
    return (
        f"{row['verdict']}: {Path(row['photo']).name}, azimuth {row['azimuth_deg']:.1f}, elevation"
        f" {row['elevation_deg']:.1f} degrees, albedo ({colour}), {seen}; {row['reason']} ({when})"
    )


def result_folders(images: Sequence[Path], out: Path) -> list[Path]:
    """A folder for each photo, named after it; a number is added where two photos share a name."""
    used = set(TAKEN)
    folders = []
    for image in images:
        name, number = image.stem, 2
        while name in used:
            name, number = f"{image.stem}-{number}", number + 1
        used.add(name)
        folders.append(out / name)
    return folders
