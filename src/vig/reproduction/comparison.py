"""Table 1 beside the paper's: our medians and intervals, its numbers, and whether ours are better."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from vig.evaluation import METRICS
from vig.evaluation.paper import compare
from vig.evaluation.presentation import Block

TITLES = {"raster": "rasterised photos (the paper's OpenGL)", "cycles": "path-traced photos (photorealistic)"}


@dataclass(frozen=True)
class Entry:
    """A cell of the table. ours: median and interval. paper: its number. passed: ours is better; None: the
    paper has none."""

    ours: str
    paper: str = ""
    passed: bool | None = None

    @property
    def verdict(self) -> str:
        """pass, fail, or nothing."""
        return "" if self.passed is None else "pass" if self.passed else "fail"


def entries(table: Mapping[str, Any]) -> dict[str, dict[str, Entry]]:
    """Metric to method to cell, of a table from `vig.evaluation.summarise` at the paper's occlusion."""
    beside = {(cell.metric, cell.method): cell for cell in compare(table)}
    found: dict[str, dict[str, Entry]] = {}
    for metric, row in table["rows"].items():
        found[metric] = {}
        for method, summary in row.items():
            low, high = summary["ci95"]
            ours = f"{told(summary['median'])} [{told(low)}, {told(high)}]"
            cell = beside.get((metric, method))
            entry = Entry(ours) if cell is None else Entry(ours, f"paper {told(cell.paper)}", cell.passed)
            found[metric][method] = entry
    return found


def comparison_title(table: Mapping[str, Any]) -> str:
    """What the table is of."""
    return (
        f"Table 1, {TITLES[table['tier']]}: medians over {table['count']} photos with at most"
        f" {table['max_occlusion']:.0%} of the object hidden, [95 % interval], the paper's below"
    )


def comparison_block(table: Mapping[str, Any]) -> Block:
    """The table for a terminal and for Markdown."""
    found = entries(table)
    methods = methods_of(found)
    rows = [
        [METRICS[metric], *(_lines(row.get(method)) for method in methods)] for metric, row in found.items()
    ]
    return Block(comparison_title(table), ["", *methods], rows)


def methods_of(found: Mapping[str, Mapping[str, Entry]]) -> list[str]:
    """The columns, in the order in which they were asked for."""
    return list(dict.fromkeys(method for row in found.values() for method in row))


def told(value: float) -> str:
    """Three significant digits, at most four decimals."""
    places = 4 if abs(value) < 0.1 else 3 if abs(value) < 1 else 2 if abs(value) < 10 else 1
    return f"{value:.{places}f}"


def _lines(entry: Entry | None) -> str:
    if entry is None:
        return "-"
    return f"{entry.ours}\n{entry.paper}, {entry.verdict}" if entry.verdict else entry.ours
