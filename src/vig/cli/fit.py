"""`vig fit`: photos explained, a folder each."""

from __future__ import annotations

import json
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
from vig.cli.hints import hints_of
from vig.errors import UserError
from vig.explainer import Box, checked_box
from vig.files import atomic_write
from vig.inference import ExplainSettings
from vig.likelihood import LIKELIHOODS
from vig.optimizers import OPTIMIZERS
from vig.photo.video import frames_of, is_video
from vig.report.page import Entry, folder_html, thumbnail
from vig.runs import RunSettings, Task, run, run_tracked, write_table

MOST_ENTRIES = 200
"""Photos on a run's page, at most."""
FRAMES = "frames"
"""Folder of the frames of videos within that of the results."""
FRAMINGS = {"auto": None, "fixed": False, "free": True}


def fit(settings: Fit) -> int:
    """Explain every photo into a folder of its own; returns the exit code."""
    if settings.track:
        _check_track(settings)
    photos = photos_of(settings.images, settings.out)
    boxes = boxes_of(settings, photos)
    hints = hints_of(settings, photos)
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
    tasks = [
        Task(photo, folder, box, settings.focal, told)
        for photo, folder, box, told in zip(photos, folders, boxes, hints, strict=True)
    ]
    found: dict[str, dict[str, Any]] = {}

    def done(row: dict[str, Any]) -> None:
        found[row["folder"]] = row
        line = in_one_line(_line(row))
        note(line)
        if row["error"] is not None:
            print(f"vig: {in_one_line(row['error'])}", file=sys.stderr, flush=True)
        elif not settings.json and not settings.quiet:
            print(line, flush=True)

    rows: list[dict[str, Any]] = []
    try:
        if settings.track:
            run_tracked(tasks, settings.out, given, done)
        else:
            for row in run(tasks, settings.out, given, settings.workers, len(photos) > 1, settings.cluster):
                done(row)
    finally:
        rows += [found[folder.name] for folder in folders if folder.name in found]
        if len(photos) > 1 and rows:
            write_table(settings.out, rows)
            _write_page(settings.out, rows)
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
    """report.html of a run: the photos that are least sure, `MOST_ENTRIES` of them."""
    seen = [row for row in rows if row["error"] is None]
    seen.sort(key=lambda row: (row["view_trusted"], row["confidence"] is not None, row["confidence"] or 0.0))
    entries = []
    for row in seen[:MOST_ENTRIES]:
        with suppress(OSError), Image.open(out / row["folder"] / "overlay.png") as picture:
            entries.append(Entry(Path(row["photo"]).name, row["folder"], row, thumbnail(np.asarray(picture))))
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


def _check_track(settings: Fit) -> None:
    """UserError where what was given does not go with `--track`."""
    if len(settings.images) != 1 or not (settings.images[0].is_dir() or is_video(settings.images[0])):
        came = f"{len(settings.images)} names" if len(settings.images) != 1 else f"'{settings.images[0]}'"
        raise UserError(
            f"expected one folder of frames or one video with --track; got {came}. Track one by one."
        )
    for name in ("boxes", "cluster", "mask", "marks", "points", "azimuth", "pose"):
        if getattr(settings, name) not in (None, ()):
            raise UserError(f"expected --track without --{name}; got both. Leave one out.")
    if settings.workers > 1:
        raise UserError(
            "expected --track with one worker, as frames follow from each other. Leave out --workers."
        )


def photos_of(images: tuple[Path, ...], out: Path) -> list[Path]:
    """The photos that are named, those in folders that are, and frames of videos, which are put into
    `out`/frames first; UserError when there are none.
    """
    photos: list[Path] = []
    known = Image.registered_extensions()
    folders = iter(
        result_folders([image for image in images if is_video(image) and not image.is_dir()], out / FRAMES)
    )
    for image in images:
        if is_video(image) and not image.is_dir():
            photos += frames_of(image, next(folders))
            continue
        found = (
            [path for path in image.iterdir() if path.suffix.lower() in known] if image.is_dir() else [image]
        )
        if not found:
            raise UserError(f"expected photos in '{image}'; got none. Name others.")
        photos += sorted(found)
    if not photos:
        raise UserError("expected at least one photo, such as `vig fit photo.jpg`; got none.")
    return photos


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
    used: set[str] = set()
    folders = []
    for image in images:
        name, number = image.stem, 2
        while name in used:
            name, number = f"{image.stem}-{number}", number + 1
        used.add(name)
        folders.append(out / name)
    return folders
