"""The paper's Table 1 from per-image errors: medians with confidence intervals, means beside them."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from vig.dataset.metrics import shape_ratio
from vig.errors import UserError
from vig.files import atomic_write
from vig_lab.evaluation.statistics import interval, resampled, summary, within

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

OTHER_METRICS = {
    "shape_paper": "shape, root of summed squares (m)",
    "appearance_ab": "appearance (CIE ab)",
    "illumination_relative": "illumination / truth's norm",
}
"""Measured beside them: shape as the paper's code has it, and the true measures of what it has otherwise."""

BASELINE = "baseline"
"""The method that answers every image with the training mean; its shape is the unit of `shape_ratio`."""


def build_table(
    results: Mapping[str, Mapping[str, Any]],
    occlusion: Any,
    tier: str,
    rng: np.random.Generator,
    max_occlusion: float = 0.75,
    resamples: int = 1000,
    min_occlusion: float = 0.0,
) -> dict[str, Any]:
    """Summarise errors over all images whose occlusion is within limits; see `statistics.within`.

    results: method -> metric -> (N,) finite errors, in any of `METRICS` but "shape_ratio", which follows from
    "shape_mm" where there is a method "baseline", and of `OTHER_METRICS`; a method may lack metrics.
    occlusion: (N,) in [0, 1]. tier: which renderer made the images, "raster" or "cycles".

    Returns `{"tier", "count", "max_occlusion", "min_occlusion", "rows": {metric: {method: {"median", "mean",
    "ci95"}}}, "other_rows"}`: plain numbers, ready for JSON. ci95 is the percentile bootstrap interval of the
    median, from the same resampled images for every method and metric.

    Raises ValueError for unknown metrics, lengths that differ and values that are not finite; UserError when
    no image is within the limits.
    """
    occlusion = np.asarray(occlusion, dtype=np.float64)
    chosen = within(occlusion, min_occlusion, max_occlusion)
    count = int(chosen.sum())
    check_limits(occlusion, min_occlusion, max_occlusion)
    errors = {
        method: {metric: _checked(method, metric, values, chosen) for metric, values in metrics.items()}
        for method, metrics in results.items()
    }
    drawn = resampled(count, rng, resamples)
    unit = errors.get(BASELINE, {}).get("shape_mm")
    rows: dict[str, dict[str, Any]] = {}
    for metric in METRICS | OTHER_METRICS:
        for method, values in errors.items():
            if metric in values:
                summarised = summary(values[metric], drawn)
            elif metric == "shape_ratio" and unit is not None and "shape_mm" in values:
                shape = values["shape_mm"]
                medians = np.median(shape[drawn], axis=1) / np.median(unit[drawn], axis=1)
                summarised = summary(shape_ratio(shape, unit), drawn) | {"ci95": interval(medians)}
            else:
                continue
            rows.setdefault(metric, {})[method] = summarised
    return {
        "tier": tier,
        "count": count,
        "max_occlusion": max_occlusion,
        "min_occlusion": min_occlusion,
        "rows": {metric: row for metric, row in rows.items() if metric in METRICS},
        "other_rows": {metric: row for metric, row in rows.items() if metric in OTHER_METRICS},
    }


def save_table(path: str | Path, table: Mapping[str, Any]) -> None:
    """Write a table from `build_table` as JSON (`table.json`)."""
    with atomic_write(path) as temporary:
        temporary.write_text(json.dumps(table, indent=2, allow_nan=False) + "\n")


def check_limits(occlusion: np.ndarray, least: float, most: float) -> None:
    """Raise UserError when none of the images is within the limits of occlusion."""
    if within(occlusion, least, most).any():
        return
    if not occlusion.size:
        came, remedy = "there are no images at all", "Use another dataset."
    elif least == 0:
        came, remedy = f"the lowest is {occlusion.min():.0%}", "Raise the limit or use another dataset."
    else:
        came = f"they have from {occlusion.min():.0%} to {occlusion.max():.0%}"
        remedy = "Change the limits or use another dataset."
    asked = f"at most {most:.0%}" if least == 0 else f"more than {least:.0%} and at most {most:.0%}"
    raise UserError(f"expected images with {asked} of the object hidden; {came}. {remedy}")


def _checked(method: str, metric: str, values: Any, chosen: np.ndarray) -> np.ndarray:
    array = np.asarray(values, dtype=np.float64)
    if metric == "shape_ratio" or metric not in METRICS | OTHER_METRICS:
        known = ", ".join(name for name in METRICS | OTHER_METRICS if name != "shape_ratio")
        raise ValueError(f"unknown metric {metric!r} of {method!r}; expected one of {known}")
    if array.shape != chosen.shape:
        raise ValueError(f"{method} {metric}: expected one value per image {chosen.shape}; got {array.shape}")
    if not np.isfinite(array).all():
        raise ValueError(f"{method} {metric}: {np.count_nonzero(~np.isfinite(array))} values are not finite")
    return array[chosen]
