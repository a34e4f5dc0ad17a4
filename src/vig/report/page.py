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
