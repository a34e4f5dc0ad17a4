"""The page of a reproduction: tables beside the paper's, figures, and how it was made, in one HTML file."""

from __future__ import annotations

import csv
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from vig.evaluation import METRICS
from vig.evaluation.paper import Compared, compare
from vig.evaluation.presentation import Block, blocks
from vig.reproduction import LIMITS, TIERS, RunFolder, duration, read_record
from vig.report.html import Cell, listing, paragraph, picture, table, write_html

TITLES = {"raster": "Rasterised photos", "cycles": "Path-traced photos"}
PICTURES = {
    "photos.png": "Test photos, from freely seen to hidden; the object's hidden part is tinted.",
    "figure3.png": "Figure 3: median errors over all photos with at most so much of the object hidden.",
    "figure3-bins.png": "The same in separate ranges of occlusion.",
    "figure4.png": "Figure 4: photos and what is made of them, chosen by rank of their error, not by hand.",
    "figure5.png": "Figure 5: the masks of the same photos.",
    "reliability.png": "How often the truth lies within stated intervals; on the diagonal they are right.",
    "fit.webp": "A fit, from the recognition model's guess to its end.",
}


def write_page(root: Path) -> Path:
    """Write `index.html` of a run's folder from what lies there; what is not there yet is left out.

    Raises UserError when the folder holds no run.
    """
    folder = RunFolder(root)
    record = read_record(folder.record)
    tables = {tier: _read(folder.tables(tier) / "table.json") for tier in TIERS}
    tables = {tier: found for tier, found in tables.items() if found is not None}
    write_html(
        folder.page,
        "Overcoming Occlusion with Inverse Graphics, reproduced by vig",
        _lead(record, tables),
        [
            *((tier, TITLES[tier], _tier(folder, tier, found)) for tier, found in tables.items()),
            ("ablations", "Ablations", _ablations(folder)),
            ("training", "Training", _training(folder)),
            ("making", "How it was made", _making(record)),
        ],
    )
    return folder.page


def table_1(tier: str, found: Mapping[str, Any]) -> str:
    """Table 1 of a tier: our medians and intervals, the paper's value and the verdict below."""
    rows = found["rows"]
    methods = list(dict.fromkeys(method for row in rows.values() for method in row))
    beside = {(cell.metric, cell.method): cell for cell in compare(found)}
    body = [
        (METRICS[metric], [_median(row.get(method), beside.get((metric, method))) for method in methods])
        for metric, row in rows.items()
    ]
    caption = (
        f"Table 1, {TITLES[tier].lower()}: medians over {found['count']} photos with at most"
        f" {found['max_occlusion']:.0%} of the object hidden, [95 % interval], the paper's beside them."
    )
    return table(caption, ["", *methods], body)


def _lead(record: Mapping[str, Any], tables: Mapping[str, Any]) -> str:
    """What the page is of, and how much of Table 1 passes, in two paragraphs."""
    settings = record["settings"]
    lead = paragraph(
        "The experiments of section 5 of Moreno, Williams, Nash and Kohli (2016), at the scale"
        f" “{settings['scale']}”. A cell of Table 1 passes when our median is better than the"
        " paper's. The photos are our own: scenes, light and designs of the test photos occur in no training"
        " photo."
    )
    for tier, found in tables.items():
        cells = compare(found)
        failed = [f"{METRICS[cell.metric]} of {cell.method}" for cell in cells if not cell.passed]
        lead += paragraph(
            f"{TITLES[tier]}: {len(cells) - len(failed)} of {len(cells)} cells pass"
            + (f"; not {', '.join(failed)}." if failed else ".")
        )
    return lead


def _median(summary: Mapping[str, Any] | None, beside: Compared | None) -> Cell:
    """A cell of Table 1."""
    if summary is None:
        return Cell("–")
    low, high = summary["ci95"]
    ours = f"{_digits(summary['median'])} [{_digits(low)}, {_digits(high)}]"
    if beside is None:
        return Cell(ours)
    return Cell(ours, f"paper {_digits(beside.paper)}", beside.passed)


def _tier(folder: RunFolder, tier: str, found: Mapping[str, Any]) -> str:
    """Tables and figures of a tier."""
    _, *others = blocks(found)
    html = table_1(tier, found) + "".join(_block(each) for each in others)
    for name in LIMITS:
        hidden = _read(folder.tables(tier) / f"{name}.json")
        if name != "table" and hidden is not None:
            html += _block(blocks(hidden)[0])
    return html + "".join(picture(folder.figures(tier) / name, said) for name, said in PICTURES.items())


def _block(block: Block) -> str:
    rows = [(row[0], [Cell(*cell.split("\n", 1)) for cell in row[1:]]) for row in block.rows]
    return table(block.title, [name.replace("\n", " ") for name in block.header], rows)


def _ablations(folder: RunFolder) -> str:
    return ""


def _training(folder: RunFolder) -> str:
    """The curve of the training and its last line; nothing when weights were given."""
    log = folder.recognition / "log.csv"
    html = picture(folder.recognition / "losses.png", "The losses of the training, epoch by epoch.")
    if log.exists():
        with open(log, newline="") as file:
            *_, last = csv.reader(file)
    return html


def _making(record: Mapping[str, Any]) -> str:
    """The command, the settings, the machine, and how long each step took."""
    machine = record["machine"]
    packages = ", ".join(f"{name} {version}" for name, version in machine.get("packages", {}).items())
    html = listing([record["command"]])
    html += paragraph(
        f"vig {record['vig']}, Python {machine.get('python')}, {machine.get('cpus')} x"
        f" {machine.get('processor')}, {machine.get('platform')}; {packages}."
    )
    settings = [(name.replace("_", " "), [_told(value)]) for name, value in record["settings"].items()]
    html += table("Settings", ["", ""], settings)
    steps = [
        (name, [duration(step["seconds"]), str(step["sittings"]), step["finished"] or "not finished"])
        for name, step in record["steps"].items()
    ]
    total = sum(step["seconds"] for step in record["steps"].values())
    steps.append(("all", [duration(total), "", ""]))
    return html + table("Steps", ["", "time", "sittings", "finished (UTC)"], steps)


def _read(path: Path) -> dict[str, Any] | None:
    """A table of the run; None when it is not there."""
    return json.loads(path.read_text()) if path.exists() else None


def _told(value: Any) -> str:
    if value is None:
        return "–"
    return ", ".join(value) if isinstance(value, list) else str(value)
