"""`vig demo`: the packaged photos explained, truth beside estimate."""

import json
import math
import shlex
import sys
import time
import webbrowser
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from shutil import which
from typing import Any

import numpy as np
from PIL import Image
from rich.console import Console
from rich.table import Table

from vig.explainer import Explainer
from vig.explanation import Explanation
from vig.io.printing import end
from vig.scene import angle_difference
from vig_app.cli.common import Demo
from vig_app.cli.results import has_screen
from vig_app.demo import DemoPhoto, demo_photos
from vig_app.report.folder import save_explanation
from vig_app.report.gallery import Card, card_of, gallery_html
from vig_app.report.html import write_page
from vig_app.report.sheet import write_sheets
from vig_app.results import row_of_record

NUMBERS = ("hidden", "azimuth", "elevation", "albedo", "shape error", "mask IoU")  # columns of the table
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

    def say(row: Mapping[str, Any]) -> None:
        if not as_json:
            console.print(f"explained {row['photo']}: {row['verdict']}", highlight=False)

    rows, cards = explain_demo(out, say)
    seconds = time.monotonic() - started
    page = out / "report.html"
    note = f"{DEMO_NOTE} A photo's name leads to its own page."
    write_page(page, gallery_html(cards, "vig's demo", note))
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
    hard = demo_photos()[3]  # something stands before it
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


def explain_demo(
    out: Path, say: Callable[[Mapping[str, Any]], None] = lambda row: None
) -> tuple[list[dict[str, Any]], list[Card]]:
    """Explain the packaged photos into a folder, without boxes, with a sheet of all.

    say: Called with each row as it is done.

    Returns:
        Truth and estimate of each photo, and its card of a gallery.
    """
    photos, rows, cards, described = demo_photos(), [], [], []
    explainers = {name: Explainer(name) for name in dict.fromkeys(photo.class_name for photo in photos)}
    for photo in photos:
        explanation = explainers[photo.class_name].explain(photo.photo)
        folder = save_explanation(explanation, out / photo.name, photo.photo.name)
        described.append(row_of_record(explanation.to_dict(), photo=photo.photo.name, folder=photo.name))
        rows.append(_compare(photo, explanation, described[-1]["verdict"]))
        truth = f"truth: azimuth {photo.azimuth_deg:.0f}°, {photo.occlusion:.0%} hidden"
        truth = truth if photo.present else f"truth: a {photo.shows}, no {photo.class_name}"
        cards.append(card_of(folder, photo.title, truth, f"{photo.name}/report.html"))
        say(rows[-1])
    # Pixels of a photo's side: docs/demo.jpg is this sheet.
    write_sheets(out, described, 396, "overlay.png")
    return rows, cards


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


def _compare(photo: DemoPhoto, explanation: Explanation, verdict: str) -> dict[str, Any]:
    """Return truth and estimate of a photo as numbers; null where it does not show the class asked for."""
    shown = photo.present
    truth = {
        "hidden": round(photo.occlusion, 3),
        "azimuth_deg": photo.azimuth_deg % 360,
        "elevation_deg": photo.elevation_deg,
        "albedo": list(photo.albedo),
    }
    described = explanation.to_dict() | {"hidden": explanation.to_dict()["hidden_fraction"]}
    with Image.open(photo.visible_mask) as image:
        visible = np.asarray(image) > 127
    azimuth_error = angle_difference(float(explanation.latents.azimuth[0]), math.radians(photo.azimuth_deg))
    distances = np.linalg.norm(explanation.vertices - photo.vertices, axis=1) if shown else np.zeros(1)
    errors = {
        "azimuth_error_deg": math.degrees(abs(azimuth_error)),
        "shape_error_mm": 1000 * float(distances.mean()),
        "segmentation_iou": float((explanation.mask & visible).sum() / (explanation.mask | visible).sum()),
    }
    names = {"photo": photo.name, "class": photo.class_name, "shows": photo.shows}
    estimates = {name: [value if shown else None, described[name]] for name, value in truth.items()}
    return {**names, **estimates, **(errors if shown else dict.fromkeys(errors)), "verdict": verdict}
