"""`vig demo`: the packaged example photos explained, truth beside estimate."""

from __future__ import annotations

import json
import math
import os
import shlex
import sys
import time
import webbrowser
from collections.abc import Mapping
from pathlib import Path
from shutil import which
from typing import Any

import numpy as np
import torch
from PIL import Image
from rich.console import Console
from rich.table import Table

from vig.explainer import Explainer
from vig.explanation import Explanation
from vig.inference import ExplainSettings
from vig.photo import Window
from vig.photo.images import write_png
from vig.scene import IMAGE_SIZE, angle_difference
from vig_app.cli.common import Demo
from vig_app.examples import Example, example_photos
from vig_app.report.folder import save_entry
from vig_app.report.folder_page import folder_html
from vig_app.report.html import write_page

HARD_EXAMPLE = 3
"""That the commands to try name: something stands before it."""
COMMANDS_TO_TRY = (
    "vig fit photo.jpg                  # a teapot of yours (or --class mug); see vig-fit/photo/report.html",
    "vig fit {photo} --elevation {elevation:.0f}     # tell what you know; docs/hints.md",
    "vig class build MESHES --out PACK  # another kind of object, from a folder of meshes",
)
"""Commands to try after the demo."""


def demo(settings: Demo) -> int:
    """Explain every example into a folder and print a table, or JSON."""
    out, as_json = settings.out, settings.json
    console = Console(width=None if sys.stdout.isatty() else 140)
    started = time.monotonic()
    explainer = Explainer("teapot", ExplainSettings(free_framing=False))
    rows, entries = [], []
    for example in example_photos():
        explanation = explainer.explain(example.photo, window=Window(0, 0, IMAGE_SIZE))
        photo = example.photo.name
        entries.append(save_entry(explanation, out / example.name, photo, photo)[0])
        rows.append(_compared(example, explanation, entries[-1].described))
        if not as_json:
            console.print(f"explained {example.name}: {rows[-1]['verdict']}", highlight=False)
    seconds = time.monotonic() - started
    write_overview(out, [example.photo for example in example_photos()], [row["photo"] for row in rows])
    page = out / "report.html"
    write_page(page, folder_html(entries))
    if as_json:
        print(json.dumps({"photos": rows, "seconds": round(seconds, 1), "folder": str(out)}, indent=2))
        return 0
    table = Table(title="truth | estimate", title_justify="left")
    for name in ("photo", "hidden", "azimuth", "elevation", "albedo", "shape error", "mask IoU", "verdict"):
        table.add_column(name, justify="left" if name in ("photo", "verdict") else "right")
    for row in rows:
        table.add_row(
            row["photo"],
            f"{row['hidden'][0]:.0%} | {row['hidden'][1]:.0%}",
            f"{row['azimuth_deg'][0]:.1f} | {row['azimuth_deg'][1]:.1f}",
            f"{row['elevation_deg'][0]:.1f} | {row['elevation_deg'][1]:.1f}",
            " | ".join(" ".join(f"{c:.2f}" for c in colour) for colour in row["albedo"]),
            f"{row['shape_error_mm']:.1f} mm",
            f"{row['segmentation_iou']:.2f}",
            row["verdict"],
        )
    console.print(table)
    console.print(
        f"{len(rows)} photos in {seconds:.0f} s; median azimuth error"
        f" {np.median([row['azimuth_error_deg'] for row in rows]):.1f} degrees, median IoU"
        f" {np.median([row['segmentation_iou'] for row in rows]):.2f}",
        highlight=False,
    )
    hard = example_photos()[HARD_EXAMPLE]
    hints = {"photo": hard.photo, "elevation": math.degrees(float(hard.truth.elevation))}
    commands = [line.format(**hints) for line in COMMANDS_TO_TRY]
    if which("vig") is None:  # of an environment that is not active
        vig = shlex.join([sys.executable, "-m", "vig"])
        commands = [line.replace("vig ", f"{vig} ", 1) for line in commands]
    lines = [f"The page: {page}", "Try next:", *(f"    {line}" for line in commands)]
    console.print("\n".join(lines), soft_wrap=True, highlight=False, markup=False)
    if not settings.no_open and has_screen():
        webbrowser.open(page.resolve().as_uri())
    print(out)
    return 0


def has_screen() -> bool:
    """Whether somebody sits before it: a terminal, and a display where the system has such."""
    displays = sys.platform in ("win32", "darwin") or any(
        os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY")
    )
    return sys.stdout.isatty() and displays


def write_overview(
    out: Path, photos: list[Path], names: list[str], cell: int = 224, columns: int = 4
) -> None:
    """`out`/overview.png: every photo beside its overlay, `columns` pairs to a line."""
    lines = math.ceil(len(photos) / columns)
    sheet = Image.new("RGB", (columns * 2 * cell, lines * cell), "white")
    for number, (photo, name) in enumerate(zip(photos, names, strict=True)):
        left, top = number % columns * 2 * cell, number // columns * cell
        for offset, path in ((0, photo), (cell, out / name / "overlay.png")):
            with Image.open(path) as picture:
                sheet.paste(picture.convert("RGB").resize((cell - 4, cell - 4)), (left + offset, top))
    write_png(out / "overview.png", np.asarray(sheet))


def _compared(example: Example, explanation: Explanation, described: Mapping[str, Any]) -> dict[str, Any]:
    """Truth and estimate of one example as plain numbers."""
    truth = example.truth
    visible = np.asarray(Image.open(example.visible_mask)) > 127
    distances = np.linalg.norm(explanation.vertices - example.vertices, axis=1)
    azimuth_error = angle_difference(float(explanation.latents.azimuth), float(truth.azimuth))
    return {
        "photo": example.name,
        "hidden": [round(example.occlusion, 3), described["hidden_fraction"] or 0.0],
        "azimuth_deg": [math.degrees(float(truth.azimuth)) % 360, described["azimuth_deg"]],
        "elevation_deg": [math.degrees(float(truth.elevation)), described["elevation_deg"]],
        "albedo": [truth.albedo[0].tolist(), described["albedo"]],
        "azimuth_error_deg": math.degrees(abs(azimuth_error)),
        "shape_error_mm": 1000 * float(distances.mean()),
        "segmentation_iou": float((explanation.mask & visible).sum() / (explanation.mask | visible).sum()),
        "verdict": described["verdict"],
        "light": [truth.light[0].tolist(), torch.as_tensor(described["light"]).tolist()],
    }
