"""`vig demo`: the packaged photos explained, truth beside estimate."""

from __future__ import annotations

import json
import math
import os
import shlex
import sys
import time
import webbrowser
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from shutil import which
from typing import Any

import numpy as np
from PIL import Image, ImageDraw, ImageFont
from rich.console import Console
from rich.table import Table

from vig.explainer import Explainer
from vig.explanation import Explanation
from vig.io.files import atomic_write
from vig.io.printing import end
from vig.photo.images import coded
from vig.scene import angle_difference
from vig_app.cli.common import Demo
from vig_app.demo import DemoPhoto, demo_photos
from vig_app.pictures import overlay
from vig_app.report.folder import FILES, save_entry
from vig_app.report.folder_page import Entry, reduced
from vig_app.report.gallery import Card, card_of, gallery_html
from vig_app.report.html import QUALITY, write_page

CELL, GAP, CAPTION, COLUMNS = 396, 5, 24, 4
"""Pixels of a photo's side in overview.jpg, between photos, and of a caption's height; photos in a row."""
NUMBERS = ("hidden", "azimuth", "elevation", "albedo", "shape error", "mask IoU")
"""Columns of the table."""
HARD_PHOTO = 3
"""That the commands to try name: something stands before it."""
COMMANDS_TO_TRY = (
    "vig fit photo.jpg                  # a teapot of yours (or --class mug); see vig-fit/photo/report.html",
    "vig fit {photo} --elevation {elevation:.0f}     # tell what you know; docs/hints.md",
    "vig class build MESHES --out PACK  # another kind of object, from a folder of meshes",
)
"""Commands to try after the demo."""
DEMO_NOTE = "Path-traced photos as people take them, explained without a box."


def demo(settings: Demo) -> int:
    """Explain every photo into a folder, found without a box, and print a table, or JSON."""
    out, as_json = settings.out, settings.json
    console = Console(width=None if sys.stdout.isatty() else 140)
    started = time.monotonic()
    photos = demo_photos()
    rows, entries, cards = [], [], []
    for photo, explanation, entry in explained_demo(photos, out):
        rows.append(_compared(photo, explanation, entry.described))
        entries.append(_enlarged(entry, explanation))
        cards.append(demo_card(photo, out, entry.link))
        if not as_json:
            console.print(f"explained {photo.name}: {rows[-1]['verdict']}", highlight=False)
    seconds = time.monotonic() - started
    write_overview(out / "overview.jpg", entries)
    page = out / "report.html"
    write_page(page, gallery_html(cards, "vig's demo", f"{DEMO_NOTE} A photo's name leads to its own page."))
    if as_json:
        print(json.dumps({"photos": rows, "seconds": round(seconds, 1), "folder": str(out)}, indent=2))
        return 0
    console.print(_table(rows))
    shown = [row for row in rows if row["shows"] == row["class"]]
    azimuth, iou = (
        float(np.median([row[key] for row in shown])) for key in ("azimuth_error_deg", "segmentation_iou")
    )
    console.print(
        f"{len(rows)} photos in {seconds:.0f} s; of the {len(shown)} that show what was asked for"
        f" median azimuth error {azimuth:.1f} degrees, median IoU {iou:.2f}",
        highlight=False,
        soft_wrap=True,
    )
    hard = photos[HARD_PHOTO]
    commands = [line.format(photo=hard.photo, elevation=hard.elevation_deg) for line in COMMANDS_TO_TRY]
    if which("vig") is None:  # in an environment that is not active
        vig = shlex.join([sys.executable, "-m", "vig"])
        commands = [line.replace("vig ", f"{vig} ", 1) for line in commands]
    lines = [f"The page: {page}", "Try next:", *(f"    {line}" for line in commands)]
    console.print("\n".join(lines), soft_wrap=True, highlight=False, markup=False)
    if not settings.no_open and has_screen():
        webbrowser.open(page.resolve().as_uri())
    end(out, f"explained {len(rows)} photos: open {page}; then one of yours, as above")
    return 0


def explained_demo(
    photos: Sequence[DemoPhoto], out: Path, files: Sequence[str] = FILES
) -> Iterator[tuple[DemoPhoto, Explanation, Entry]]:
    """Explain the packaged photos, found without a box, each into a folder of its name."""
    explainers = {name: Explainer(name) for name in dict.fromkeys(photo.class_name for photo in photos)}
    for photo in photos:
        explanation = explainers[photo.class_name].explain(photo.photo)
        name = photo.photo.name
        yield photo, explanation, save_entry(explanation, out / photo.name, name, name, files)[0]


def demo_card(photo: DemoPhoto, out: Path, link: str = "") -> Card:
    """Return the gallery's card of a packaged photo that was explained into `out`, with the truth."""
    truth = f"truth: azimuth {photo.azimuth_deg:.0f}°, {photo.occlusion:.0%} hidden"
    if not photo.present:
        truth = f"truth: a {photo.shows}, no {photo.class_name}"
    return card_of(out / photo.name, photo.title, truth, link)


def has_screen() -> bool:
    """Return whether the session is interactive: a terminal, and a display where the system has such."""
    displays = sys.platform in ("win32", "darwin") or any(
        os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY")
    )
    return sys.stdout.isatty() and displays


def write_overview(path: Path, entries: Sequence[Entry]) -> None:
    """Write a picture of all photos with their explanations, `COLUMNS` to a row."""
    step = CELL + GAP
    rows = math.ceil(len(entries) / COLUMNS)
    sheet = Image.new("RGB", (COLUMNS * step - GAP, rows * (step + CAPTION) - GAP), "white")
    draw, font = ImageDraw.Draw(sheet), ImageFont.load_default(15)
    for number, entry in enumerate(entries):
        left, top = number % COLUMNS * step, number // COLUMNS * (step + CAPTION)
        picture = Image.fromarray(entry.picture).resize((CELL, CELL), Image.Resampling.LANCZOS)
        sheet.paste(picture, (left, top))
        draw.text((left + 2, top + CELL + 2), _caption(entry.described), "black", font)
    with atomic_write(path) as temporary:
        sheet.save(temporary, "JPEG", quality=QUALITY)


def _caption(described: Mapping[str, Any]) -> str:
    """Describe the result in a few words."""
    name, verdict = described["class"], described["verdict"]
    if verdict == "absent":
        return f"{name}: absent"
    hidden = described["hidden_fraction"] or 0.0
    return f"{name}: {verdict}, azimuth {described['azimuth_deg']:.0f}°, {hidden:.0%} hidden"


def _enlarged(entry: Entry, explanation: Explanation) -> Entry:
    """Enlarge the picture beyond that of many photos."""
    # 480: pixels of a photo's longer side from which overview.jpg is made
    picture = reduced(coded(explanation.picture), 480)
    if entry.described["verdict"] != "absent":
        picture = overlay(explanation, picture)
    return replace(entry, picture=picture)


def _table(rows: Sequence[Mapping[str, Any]]) -> Table:
    """Return a table of truth and estimate; photos of other things have no truth."""
    table = Table(title="truth | estimate", title_justify="left")
    for name in ("photo", "asked", *NUMBERS, "verdict"):
        table.add_column(name, justify="right" if name in NUMBERS else "left")
    for row in rows:
        cells = [f"shows a {row['shows']}", *[""] * 5]
        if row["shows"] == row["class"]:
            cells = [
                f"{row['hidden'][0]:.0%} | {row['hidden'][1]:.0%}",
                f"{row['azimuth_deg'][0]:.1f} | {row['azimuth_deg'][1]:.1f}",
                f"{row['elevation_deg'][0]:.1f} | {row['elevation_deg'][1]:.1f}",
                " | ".join(" ".join(f"{c:.2f}" for c in colour) for colour in row["albedo"]),
                f"{row['shape_error_mm']:.1f} mm",
                f"{row['segmentation_iou']:.2f}",
            ]
        table.add_row(row["photo"], row["class"], *cells, row["verdict"])
    return table


def _compared(photo: DemoPhoto, explanation: Explanation, described: Mapping[str, Any]) -> dict[str, Any]:
    """Return truth and estimate of a photo as plain numbers; null where it does not show the class asked
    for.
    """
    row = {
        "photo": photo.name,
        "class": photo.class_name,
        "shows": photo.shows,
        "hidden": [None, described["hidden_fraction"]],
        "azimuth_deg": [None, described["azimuth_deg"]],
        "elevation_deg": [None, described["elevation_deg"]],
        "albedo": [None, described["albedo"]],
        "azimuth_error_deg": None,
        "shape_error_mm": None,
        "segmentation_iou": None,
        "verdict": described["verdict"],
    }
    if not photo.present:
        return row
    with Image.open(photo.visible_mask) as image:
        visible = np.asarray(image) > 127
    azimuth_error = angle_difference(float(explanation.latents.azimuth[0]), math.radians(photo.azimuth_deg))
    distances = np.linalg.norm(explanation.vertices - photo.vertices, axis=1)
    truth = {
        "hidden": round(photo.occlusion, 3),
        "azimuth_deg": photo.azimuth_deg % 360,
        "elevation_deg": photo.elevation_deg,
        "albedo": list(photo.albedo),
    }
    return (
        row
        | {name: [value, row[name][1]] for name, value in truth.items()}
        | {
            "azimuth_error_deg": math.degrees(abs(azimuth_error)),
            "shape_error_mm": 1000 * float(distances.mean()),
            "segmentation_iou": float(
                (explanation.mask & visible).sum() / (explanation.mask | visible).sum()
            ),
        }
    )
