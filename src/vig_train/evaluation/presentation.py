"""Summaries as short tables, for a terminal of 100 columns and in Markdown."""

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich import box
from rich.console import Group
from rich.table import Table
from rich.text import Text

from vig.io.files import atomic_write
from vig_train.evaluation.protocol import MASK_HEAD
from vig_train.evaluation.statistics import FAR_DEG, NEAR_DEG
from vig_train.evaluation.table import METRICS
from vig_train.packs.card import table_lines

GROUPS = ("azimuth", "elevation", "shape", "albedo", "light")
POSE = GROUPS[:2]
VERDICTS = ("trusted", "ambiguous", "reverted", "failed")


@dataclass(frozen=True)
class TableBlock:
    """One table: a title, a header and rows of as many cells; the first column names the row."""

    title: str
    header: Sequence[str]
    rows: Sequence[Sequence[str]]

    def rich(self) -> Group:
        """Return the table for a terminal; line breaks in cells are kept."""
        view = Table(box=box.SIMPLE_HEAD, show_edge=False, padding=(0, 0, 0, 1))
        for place, name in enumerate(self.header):
            view.add_column(name, justify="right" if place else "left", no_wrap=place > 0)
        for row in self.rows:
            view.add_row(*row)
        return Group(Text(self.title, "bold"), view, "")

    def markdown(self) -> str:
        """Return the table in Markdown, its title above it."""
        lines = table_lines(self.header, self.rows, right=True)
        return "\n".join([self.title, "", *(line.replace("\n", "<br>") for line in lines)]) + "\n"


def blocks(table: Mapping[str, Any]) -> list[TableBlock]:
    """Return the blocks of a table from `summarise`, in reading order; empty ones are left out."""
    candidates = [_medians(table), _kinds(table), _fits(table), _coverage(table)]
    return [block for block in candidates if block.rows]


def markdown(blocks: Iterable[TableBlock]) -> str:
    """Return blocks in Markdown, one after another."""
    return "\n".join(block.markdown() for block in blocks)


def save_table(path: Path, table: Mapping[str, Any], blocks: Iterable[TableBlock]) -> None:
    """Write a table as JSON, and the blocks that show it in Markdown beside it."""
    plain = json.dumps(table, indent=2, allow_nan=False) + "\n"
    for name, text in ((path, plain), (path.with_suffix(".md"), markdown(blocks))):
        with atomic_write(name) as temporary:
            temporary.write_text(text)


def metric_block(
    title: str, rows: Mapping[str, Any], cell: Callable[[str, str, Mapping[str, Any]], str]
) -> TableBlock:
    """Return a block with a line for each metric and a column for each method.

    Args:
        title: Its title.
        rows: Metric to method to summary.
        cell: Text of a summary, by metric and method.
    """
    methods = list(dict.fromkeys(method for row in rows.values() for method in row if method != MASK_HEAD))
    lines = []
    for metric, row in rows.items():
        texts = {method: cell(metric, method, summary) for method, summary in row.items()}
        lines.append([METRICS[metric], *(texts.get(method, "-") for method in methods)])
        if MASK_HEAD in texts:  # one number: no column of its own
            head = texts[MASK_HEAD]
            lines.append([f"{MASK_HEAD} (IoU)", *(head if method == "rm" else "-" for method in methods)])
    return TableBlock(title, ["", *methods], lines)


def _medians(table: Mapping[str, Any]) -> TableBlock:
    least, most = table.get("min_occlusion", 0.0), table["max_occlusion"]
    limits = f"at most {most:.0%} hidden" if least == 0 else f"{least:.0%} to {most:.0%} hidden"
    title = f"Table 1: {table['tier']}, {table['count']} images, {limits}; median (mean), 95 % interval"
    return metric_block(title, table["rows"], _median)


def _fits(table: Mapping[str, Any]) -> TableBlock:
    """Return failures of every method, and the verdicts of fits."""
    verdicts, lines = table.get("verdicts", {}), []
    for method, failures in table.get("failures", {}).items():
        low, high = failures["ci95"]
        line = [method, f"{failures['count']} ({failures['rate']:.1%}, {low:.1%} to {high:.1%})"]
        summary = verdicts.get(method)
        if summary is None:
            lines.append([*line, *["-"] * (1 + len(VERDICTS))])
            continue
        near = summary["trusted_within_15_deg"]
        counts = [str(summary["counts"].get(name, 0)) for name in VERDICTS]
        lines.append([*line, counts[0], "-" if near is None else f"{near:.1%}", *counts[1:]])
    header = ["", f"azimuth off by > {FAR_DEG:.0f}", VERDICTS[0], f"within {NEAR_DEG:.0f}", *VERDICTS[1:]]
    return TableBlock("Failures and verdicts; degrees; within: of the trusted", header, lines)


def _kinds(table: Mapping[str, Any]) -> TableBlock:
    """Return images by the share hidden, and photographs by the object's covering."""
    lines = []
    for kind, methods in table.get("kinds", {}).items():
        for method, summary in methods.items():
            verdicts, held = summary["verdicts"], summary["coverage"]
            near = None if verdicts is None else verdicts["trusted_within_15_deg"]
            trusted = "-" if verdicts is None else f"{verdicts['trusted_share']:.0%}"
            values = [
                str(summary["count"]),
                _digits(summary["azimuth_deg"]),
                f"{summary['within_15_deg']:.0%}",
            ]
            lines.append(
                [f"{kind}: {method}", *values, _digits(summary["segmentation_iou"]), trusted]
                + ["-" if near is None else f"{near:.0%}"]
                + [f"{held[name]:.0%}" if name in held else "-" for name in POSE]
            )
    header = ["", "images", "azimuth", f"within {NEAR_DEG:.0f}", "IoU", "trusted", "right"]
    header += [f"{name}\n90 %" for name in POSE]
    title = "By how much is hidden and what covers the object; medians, degrees; right: of the trusted; 90 %:"
    return TableBlock(f"{title} truths within that interval", header, lines)


def _coverage(table: Mapping[str, Any]) -> TableBlock:
    lines = []
    for method, shares in table.get("coverage", {}).items():
        # A group of several latents is pooled: its single latents are more informative.
        single = {name: share for name, share in shares.items() if f"{name}_1" not in shares}
        ends = min(single, key=single.__getitem__), max(single, key=single.__getitem__)
        lines.append(
            [
                method,
                *(f"{shares[group]:.1%}" for group in GROUPS),
                *(f"{single[name]:.1%} ({name})" for name in ends),
            ]
        )
    return TableBlock("Truths within the predicted 90 % interval", ["", *GROUPS, "least", "most"], lines)


def _median(metric: str, method: str, summary: Mapping[str, Any]) -> str:
    low, high = summary["ci95"]
    return f"{_digits(summary['median'])} ({_digits(summary['mean'])})\n[{_digits(low)}, {_digits(high)}]"


def _digits(value: float) -> str:
    """Format two or three significant digits."""
    if value == 0:
        return "0"
    decimals_from = {100: 0, 10: 1, 1: 2, 0.01: 3}  # decimals from each size on
    return f"{value:.{next((places for size, places in decimals_from.items() if abs(value) >= size), 4)}f}"
