"""The page of a reproduction: tables beside the paper's, figures, and how it was made, in one HTML file."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from vig.dataset.format import read_info
from vig.errors import UserError
from vig_lab.ablation import ablation_blocks
from vig_lab.evaluation import METRICS
from vig_lab.evaluation.paper import compare
from vig_lab.evaluation.presentation import Block, blocks
from vig_lab.reproduction.comparison import Entry, comparison, comparison_title
from vig_lab.reproduction.folder import DATASETS, TIERS, RunFolder, read_json
from vig_lab.reproduction.html import Cell, heading, listing, paragraph, picture, table, write_html
from vig_lab.reproduction.record import read_record
from vig_lab.reproduction.run import duration
from vig_lab.reproduction.stages import LIMITS

TITLE = "Overcoming Occlusion with Inverse Graphics, reproduced"
TIER_TITLES = {"raster": "Rasterised photos", "cycles": "Path-traced photos"}
PICTURES = {
    "photos.png": "Test photos, from freely seen to hidden; the object's hidden part is tinted.",
    "figure3.png": "Figure 3: median errors over all photos with at most so much of the object hidden.",
    "figure3_bins.png": "The same over separate ranges of occlusion.",
    "figure4.png": "Figure 4: photos and what is made of them; of each range of occlusion the one that"
    " stands in the middle by its errors.",
    "figure5.png": "Figure 5: the light of the same photos, in truth and as fitted.",
    "figure4_worst.png": "The photos whose azimuth is most wrong, the worst first.",
    "reliability.png": "How often the truth lies within stated intervals: on the diagonal they hold as"
    " often as they say.",
    "fit.webp": "A fit as it moves.",
}


COUNTS = ("train_images", "validation_images", "test_images", "cycles_images")
"""Settings that are told by the photos that there are."""


def write_page(root: Path) -> Path:
    """Write `index.html` of a run's folder from what lies there; what is not there yet is left out.

    Raises UserError when the folder holds no run.
    """
    folder = RunFolder(root)
    record = read_record(folder.record)
    found = {tier: folder.read_table(tier) for tier in TIERS}
    tables = {tier: each for tier, each in found.items() if each is not None}
    tiers = [(tier, TIER_TITLES[tier], _tier(folder, tier, each)) for tier, each in tables.items()]
    write_html(
        folder.page,
        TITLE,
        _lead(record, tables),
        [
            *tiers,
            ("ablations", "Ablations", _ablations(folder)),
            ("training", "Training", _training(folder)),
            ("making", "How it was made", _making(folder, record)),
        ],
    )
    return folder.page


def _lead(record: Mapping[str, Any], tables: Mapping[str, Any]) -> str:
    """What the page is of, and how much of Table 1 passes."""
    lead = paragraph(
        "Section 5 of P. Moreno, C. K. I. Williams, C. Nash and P. Kohli (ECCV 2016 Workshops), run by vig at"
        f" the scale \u201c{record['settings']['scale']}\u201d. A cell of Table 1 passes when our median is"
        " better than the paper's. The photos are vig's own; what the test photos are made of, no training"
        " photo has."
    )
    for tier, found in tables.items():
        cells = compare(found)
        failed: dict[str, list[str]] = {}
        for cell in cells:
            if not cell.passed:
                failed.setdefault(METRICS[cell.metric].split(" (")[0], []).append(cell.method)
        missed = "; ".join(f"{metric} ({', '.join(methods)})" for metric, methods in failed.items())
        passed = sum(cell.passed for cell in cells)
        told = f"{TIER_TITLES[tier]}: {passed} of {len(cells)} cells pass."
        lead += paragraph(f"{told} Not passed: {missed}." if missed else told)
    left_out = [TIER_TITLES[tier].lower() for tier in TIERS if tier not in tables]
    return lead + (paragraph(f"This run has no {' and no '.join(left_out)}.") if left_out else "")


def _tier(folder: RunFolder, tier: str, found: Mapping[str, Any]) -> str:
    """Tables and figures of a tier."""
    methods, rows = comparison(found)
    cells = [(title, [_cell(row.get(method)) for method in methods]) for title, row in rows]
    html = table(comparison_title(found), ["", *methods], cells)
    for block in blocks(found)[1:]:  # the first is Table 1 without the paper's numbers
        html += _block(block)
    for name, (least, most) in LIMITS.items():
        hidden = folder.read_table(tier, name) if name != "table" else None
        if hidden is not None:
            html += heading(f"{least:.0%} to {most:.0%} hidden")
            html += "".join(_block(block) for block in blocks(hidden))
    if folder.figures(tier).exists():
        html += heading("Figures")
    return html + "".join(picture(folder.figures(tier) / name, said) for name, said in PICTURES.items())


def _cell(entry: Entry | None) -> Cell:
    if entry is None:
        return Cell("\u2013")
    below = f"{entry.interval}\npaper {entry.paper}" if entry.paper else entry.interval
    return Cell(entry.median, below, entry.passed)


def _block(block: Block) -> str:
    """A table of the evaluation's: the first line of a cell, and a second below it."""
    rows = [(row[0], [_two_lines(cell) for cell in row[1:]]) for row in block.rows]
    return table(block.title, [name.replace("\n", " ") for name in block.header], rows)


def _two_lines(text: str) -> Cell:
    above, _, below = text.partition("\n")
    return Cell(above, below)


def _ablations(folder: RunFolder) -> str:
    """What each part of the method is worth."""
    found = read_json(folder.ablations)
    return "" if found is None else "".join(_block(block) for block in ablation_blocks(found))


def _training(folder: RunFolder) -> str:
    """The curve of the training and the last line of its log; nothing when weights were given."""
    log = folder.recognition / "log.csv"
    html = picture(folder.recognition / "losses.png", "The losses of the training, epoch by epoch.")
    said = "The network's stated uncertainty on validation photos, before and after calibration."
    html += picture(folder.recognition / "reliability.png", said)
    if log.exists():
        with open(log, newline="") as file:
            names, *_, last = csv.reader(file)
        html += table(
            "The last line of its log", [name.replace("_", " ") for name in names], [(last[0], last[1:])]
        )
    return html


def _making(folder: RunFolder, record: Mapping[str, Any]) -> str:
    """The command, the machine, the photos, the settings, and how long each step took."""
    machine = record["machine"]
    packages = ", ".join(f"{name} {version}" for name, version in machine.get("packages", {}).items())
    html = listing([record["command"]])
    html += paragraph(
        f"vig {record['vig']}, Python {machine.get('python')}, {machine.get('cpus')} x"
        f" {machine.get('processor')}, {machine.get('platform')}; {packages}."
    )
    done = {name: step for name, step in record["steps"].items() if step["complete"]}
    steps = [
        (name, [duration(step["seconds"]), str(step["sittings"]), step["finished"][:16].replace("T", " ")])
        for name, step in done.items()
    ]
    steps.append(("all", [duration(sum(step["seconds"] for step in done.values())), "", ""]))
    html += table("Photos", ["", "split", "renderer", "photos", "seed"], _photos(folder, record))
    html += table("Steps", ["", "time", "sittings", "finished (UTC)"], steps)
    settings = [
        (name.replace("_", " "), [", ".join(value) if isinstance(value, list) else str(value)])
        for name, value in record["settings"].items()
        if value is not None and name not in COUNTS
    ]
    return html + table("Settings", ["", ""], settings)


def _photos(folder: RunFolder, record: Mapping[str, Any]) -> list[tuple[str, list[str]]]:
    """Of each dataset that is there: split, renderer, count and seed."""
    rows = []
    for name, (split, _) in DATASETS.items():
        try:
            held = read_info(Path(record["settings"][name] or folder.data(name)))["splits"][split]
        except (UserError, KeyError):
            continue
        rows.append((name.replace("_", " "), [split, *(str(held[key]) for key in ("tier", "count", "seed"))]))
    return rows
