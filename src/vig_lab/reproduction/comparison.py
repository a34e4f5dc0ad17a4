"""Table 1 beside the paper's: our medians and intervals, its numbers, and whether ours are better."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from vig_lab.evaluation import METRICS
from vig_lab.evaluation.paper import Cell as Compared
from vig_lab.evaluation.paper import compare
from vig_lab.evaluation.presentation import Block
from vig_lab.evaluation.protocol import MASK_HEAD

TITLES = {"raster": "rasterised photos (the paper's OpenGL)", "cycles": "path-traced photos (photorealistic)"}


@dataclass(frozen=True)
class Entry:
    """A cell of the table: our median, its interval, the paper's number, and whether ours is better.

    The last two are empty where the paper has none.
    """

    median: str
    interval: str
    paper: str = ""
    passed: bool | None = None

    @property
    def text(self) -> str:
        """The cell as lines."""
        lines = [self.median, self.interval]
        if self.passed is not None:
            lines.append(f"{self.paper}: {'pass' if self.passed else 'fail'}")
        return "\n".join(lines)


def comparison(table: Mapping[str, Any]) -> tuple[list[str], list[tuple[str, dict[str, Entry]]]]:
    """The methods, and the rows of the table: title, and a cell for each method that has one.

    table: from `vig_lab.evaluation.summarise`, at the paper's occlusion.
    """
    beside = {(cell.metric, cell.method): cell for cell in compare(table)}
    methods: dict[str, None] = {}
    rows: list[tuple[str, dict[str, Entry]]] = []
    for metric, row in table["rows"].items():
        cells = {method: _entry(found, beside.get((metric, method))) for method, found in row.items()}
        head = cells.pop(MASK_HEAD, None)
        methods |= dict.fromkeys(cells)
        rows.append((METRICS[metric], cells))
        if head is not None:  # one number: no column of its own
            rows.append((f"{MASK_HEAD} (IoU)", {"rm": head}))
    return list(methods), rows


def comparison_title(table: Mapping[str, Any]) -> str:
    """What the table is of."""
    return (
        f"Table 1, {TITLES[table['tier']]}: medians over {table['count']} photos with at most"
        f" {table['max_occlusion']:.0%} of the object hidden, 95 % interval, the paper's number"
    )


def comparison_block(table: Mapping[str, Any]) -> Block:
    """The table for a terminal and for Markdown."""
    methods, rows = comparison(table)
    lines = [[title, *(row[m].text if m in row else "-" for m in methods)] for title, row in rows]
    return Block(comparison_title(table), ["", *methods], lines)


def _entry(summary: Mapping[str, Any], beside: Compared | None) -> Entry:
    low, high = summary["ci95"]
    ours = _told(summary["median"]), f"[{_told(low)}, {_told(high)}]"
    return Entry(*ours) if beside is None else Entry(*ours, _told(beside.paper), beside.passed)


def _told(value: float) -> str:
    """Three significant digits, at most four decimals."""
    places = 4 if abs(value) < 0.1 else 3 if abs(value) < 1 else 2 if abs(value) < 10 else 1
    return f"{value:.{places}f}"
