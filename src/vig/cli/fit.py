"""`vig fit`: photos explained, a folder each."""

from __future__ import annotations

import json
import math
import sys
import time
from collections.abc import Sequence
from datetime import datetime
from functools import partial
from pathlib import Path

from PIL import Image

from vig import __version__
from vig.checks import decode, read_json, reading
from vig.cli.common import Fit
from vig.cli.hints import hints_of
from vig.corrections import CORRECTIONS, State
from vig.errors import UserError
from vig.explainer import Box, Explainer, checked_box
from vig.explanation import Explanation
from vig.files import atomic_write
from vig.inference import ExplainSettings
from vig.likelihood import LIKELIHOODS
from vig.optimizers import OPTIMIZERS
from vig.report.page import Entry, folder_html, thumbnail

FRAMINGS = {"auto": None, "fixed": False, "free": True}


def fit(settings: Fit) -> int:
    """Explain every photo into a folder of its own; returns the exit code."""
    photos = photos_of(settings.images)
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
    explainer = Explainer(settings.object_class, how, settings.device)
    results, failed, started = {}, set(), time.monotonic()
    entries: list[Entry] = []

    def fail(number: int, error: UserError) -> None:
        print(f"vig: {error}", file=sys.stderr, flush=True)
        failed.add(number)
        note(f"error: {error}")

    number = -1
    for explanation in explainer.explain_many(photos, boxes, settings.workers, fail, settings.focal, hints):
        number += 1
        while number in failed:
            number += 1
        try:
            explanation.save(folders[number], photos[number].name)
            explanation.export(folders[number], settings.export, photos[number].name)
            said = State.of(boxes[number], settings.focal, explanation.hints)
            if said is not None:
                said.write(folders[number], photos[number], explainer.object_class)
            else:
                (folders[number] / CORRECTIONS).unlink(missing_ok=True)
        except UserError as error:
            fail(number, error)
            continue
        if len(photos) > 1:
            name, picture = photos[number].name, thumbnail(explanation.overlay())
            entries.append(Entry(name, folders[number].name, explanation.to_dict(), picture))
        results[str(photos[number])] = explanation.to_dict() | {"folder": str(folders[number])}
        seconds, started = time.monotonic() - started, time.monotonic()
        line = _line(photos[number].name, explanation, seconds)
        note(line)
        if not settings.json and not settings.quiet:
            print(line, flush=True)
    if entries:
        with atomic_write(settings.out / "report.html") as temporary:
            temporary.write_text(folder_html(entries), encoding="utf-8", errors="replace")
    if settings.json:
        print(json.dumps({"results": results, "folder": str(settings.out)}, indent=2))
    elif results:
        print(settings.out)
    return 2 if failed else 0


def add_line(log: Path | None, words: str) -> None:
    """Add a line with the time to a file, where there is one; UserError when it cannot be written."""
    if log is None:
        return
    try:
        with open(log, "a", encoding="utf-8", errors="replace") as file:
            line = "".join(each if each.isprintable() else repr(each)[1:-1] for each in words)
            print(datetime.now().isoformat(timespec="seconds"), line, file=file)
    except OSError as error:
        raise UserError(
            f"expected --log FILE that can be written; got '{log}' ({error.strerror}). Name another."
        ) from None


def photos_of(images: tuple[Path, ...]) -> list[Path]:
    """The photos that are named, and those in folders that are; UserError when there are none."""
    photos: list[Path] = []
    known = Image.registered_extensions()
    for image in images:
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


def _line(name: str, explanation: Explanation, seconds: float) -> str:
    hidden = explanation.hidden_fraction
    colour = ", ".join(f"{c:.2f}" for c in explanation.latents.albedo[0].tolist())
    sure = explanation.mask_confidence
    mask = "" if math.isnan(sure) else f" (mask right with {sure:.0%})"
    seen = "nothing seen" if hidden is None else f"{hidden:.0%} hidden{mask}"
    return (
        f"{explanation.verdict.name.lower()}: {name}, azimuth {explanation.azimuth_deg:.1f}, elevation"
        f" {explanation.elevation_deg:.1f} degrees, albedo ({colour}),"
        f" {seen}; {explanation.reason} ({seconds:.1f} s)"
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
