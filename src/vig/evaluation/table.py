"""The paper's Table 1 from per-image errors: medians with confidence intervals, means beside them."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table

from vig.errors import UserError
from vig.evaluation.metrics import shape_ratio
from vig.files import atomic_write

METRICS = {
    "azimuth_deg": "azimuth (degrees)",
    "elevation_deg": "elevation (degrees)",
    "appearance": "appearance",
    "illumination": "illumination",
    "shape_mm": "shape (mm)",
    "shape_ratio": "shape / mean shape",
    "segmentation_iou": "segmentation (IoU, more is better)",
}
"""The rows of the table: name in `table.json`, and title for people."""

BASELINE = "baseline"
"""The method that answers every image with the training mean; its shape is the unit of `shape_ratio`."""


def build_table(
    results: Mapping[str, Mapping[str, Any]],
    occlusion: Any,
    tier: str,
    rng: np.random.Generator,
    max_occlusion: float = 0.75,
    resamples: int = 1000,
) -> dict[str, Any]:
    """Summarise errors over all images whose occlusion is at most `max_occlusion`.

    results: method -> metric -> (N,) finite errors, in any of `METRICS` but "shape_ratio", which follows from
    "shape_mm" where there is a method "baseline"; a method may lack metrics. occlusion: (N,) in [0, 1].
    tier: which renderer made the images, "raster" or "cycles".

    Returns `{"tier", "count", "max_occlusion", "rows": {metric: {method: {"median", "mean", "ci95"}}}}`:
    plain numbers, ready for JSON. ci95 is the percentile bootstrap interval of the median, from the same
    resampled images for every method and metric.

    Raises ValueError for unknown metrics, lengths that differ and values that are not finite; UserError when
    no image is within `max_occlusion`.
    """
    occlusion = np.asarray(occlusion, dtype=np.float64)
    within = occlusion <= max_occlusion
    count = int(within.sum())
    if count == 0:
        lowest = f"the lowest is {occlusion.min():.0%}" if occlusion.size else "there are no images at all"
        raise UserError(
            f"expected images with at most {max_occlusion:.0%} of the object hidden; {lowest}. "
            "Raise the limit or use another dataset."
        )
    errors = {
        method: {metric: _checked(method, metric, values, within) for metric, values in metrics.items()}
        for method, metrics in results.items()
    }
    drawn = rng.integers(0, count, (resamples, count))
    unit = errors.get(BASELINE, {}).get("shape_mm")
    rows: dict[str, dict[str, Any]] = {}
    for metric in METRICS:
        for method, values in errors.items():
            if metric in values:
                summary = _summary(values[metric], np.median(values[metric][drawn], axis=1))
            elif metric == "shape_ratio" and unit is not None and "shape_mm" in values:
                shape = values["shape_mm"]
                medians = np.median(shape[drawn], axis=1) / np.median(unit[drawn], axis=1)
                summary = _summary(shape_ratio(shape, unit), medians)
            else:
                continue
            rows.setdefault(metric, {})[method] = summary
    return {"tier": tier, "count": count, "max_occlusion": max_occlusion, "rows": rows}


def save_table(path: str | Path, table: Mapping[str, Any]) -> None:
    """Write a table from `build_table` as JSON (`table.json`)."""
    with atomic_write(path) as temporary:
        temporary.write_text(json.dumps(table, indent=2, allow_nan=False) + "\n")


def rich_table(table: Mapping[str, Any]) -> Table:
    """The table for a terminal: each cell "median [95 % interval], mean"."""
    header, *body = _cells(table)
    view = Table(title=_title(table), title_justify="left")
    for index, name in enumerate(header):
        view.add_column(name, justify="left" if index == 0 else "right")
    for row in body:
        view.add_row(*row)
    return view


def markdown_table(table: Mapping[str, Any]) -> str:
    """The table as Markdown, its title above it."""
    header, *body = _cells(table)
    rule = ["---", *["---:"] * (len(header) - 1)]
    lines = ["| " + " | ".join(row) + " |" for row in (header, rule, *body)]
    return "\n".join([_title(table), "", *lines]) + "\n"


def _checked(method: str, metric: str, values: Any, within: np.ndarray) -> np.ndarray:
    array = np.asarray(values, dtype=np.float64)
    if metric not in METRICS or metric == "shape_ratio":
        known = ", ".join(name for name in METRICS if name != "shape_ratio")
        raise ValueError(f"unknown metric {metric!r} of {method!r}; expected one of {known}")
    if array.shape != within.shape:
        raise ValueError(f"{method} {metric}: expected one value per image {within.shape}; got {array.shape}")
    if not np.isfinite(array).all():
        raise ValueError(f"{method} {metric}: {np.count_nonzero(~np.isfinite(array))} values are not finite")
    return array[within]


def _summary(values: np.ndarray, medians: np.ndarray) -> dict[str, Any]:
    low, high = np.percentile(medians, [2.5, 97.5])
    return {
        "median": float(np.median(values)),
        "mean": float(values.mean()),
        "ci95": [float(low), float(high)],
    }


def _title(table: Mapping[str, Any]) -> str:
    return (
        f"{table['tier']}: {table['count']} images, at most {table['max_occlusion']:.0%} hidden; "
        "median [95 % interval], mean"
    )


def _cells(table: Mapping[str, Any]) -> list[list[str]]:
    methods = list(dict.fromkeys(method for row in table["rows"].values() for method in row))
    lines = [["", *methods]]
    for metric, row in table["rows"].items():
        lines.append([METRICS[metric], *(_cell(row[m]) if m in row else "-" for m in methods)])
    return lines


def _cell(summary: Mapping[str, Any]) -> str:
    low, high = summary["ci95"]
    digits = 3 if summary["median"] < 1 else 2
    return (
        f"{summary['median']:.{digits}f} [{low:.{digits}f}, {high:.{digits}f}], {summary['mean']:.{digits}f}"
    )
