"""All that is said of methods on a dataset, as one table ready for JSON."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from vig.dataset import Dataset
from vig_lab.evaluation.results import MethodResult
from vig_lab.evaluation.statistics import (
    BINS,
    LEVELS,
    by_occlusion,
    coverage,
    failure,
    paired_tests,
    resampled,
    standardised,
    verdicts,
    within,
)
from vig_lab.evaluation.table import BASELINE, METRICS, OTHER_METRICS, build_table

TESTED = tuple(metric for metric in METRICS | OTHER_METRICS if metric != "shape_ratio")
"""The ratio's test is that of `shape_mm`."""


def summarise(
    results: Mapping[str, MethodResult],
    dataset: Dataset,
    tier: str,
    min_occlusion: float = 0.0,
    max_occlusion: float = 0.75,
    seed: int = 0,
) -> dict[str, Any]:
    """`build_table` of the images within the limits of occlusion, and beside its rows:

    "failures": method to `statistics.failure`. "verdicts": method to `statistics.verdicts`. "coverage":
    method to group of latents to the share of truths within the stated 90 % interval. "tests": a list from
    `statistics.paired_tests`, without the baseline. "levels", "bins": of all images whatever the limits,
    {"ranges": [[least, most], ...], "counts", "rows": {metric: {method: [summary or None, ...]}}}.

    seed: of the bootstrap. Raises UserError when no image is within the limits.
    """
    rng = np.random.default_rng(np.random.SeedSequence(seed))
    errors = {method: result.errors for method, result in results.items()}
    table = build_table(
        errors, dataset.occlusion, tier, rng, max_occlusion=max_occlusion, min_occlusion=min_occlusion
    )
    chosen = within(dataset.occlusion, min_occlusion, max_occlusion)
    drawn = resampled(table["count"], rng)
    compared = {
        method: {metric: values[chosen] for metric, values in found.items()}
        for method, found in errors.items()
        if method != BASELINE and "azimuth_deg" in found
    }
    posed = {method: result for method, result in results.items() if "azimuth_deg" in result.errors}
    stating = {method: result for method, result in results.items() if result.deviation is not None}
    return table | {
        "failures": {m: failure(r.errors["azimuth_deg"][chosen], drawn) for m, r in posed.items()},
        "verdicts": {m: verdicts(r, chosen) for m, r in posed.items() if any(r.verdicts)},
        "coverage": {m: coverage(standardised(r, dataset.latents)[chosen]) for m, r in stating.items()},
        "tests": paired_tests(compared, TESTED, drawn),
        "levels": _ranges(errors, dataset.occlusion, [(0.0, level) for level in LEVELS], rng),
        "bins": _ranges(errors, dataset.occlusion, list(BINS), rng),
    }


def _ranges(
    errors: Mapping[str, Mapping[str, np.ndarray]],
    occlusion: np.ndarray,
    ranges: list[tuple[float, float]],
    rng: np.random.Generator,
) -> dict[str, Any]:
    """Every metric of every method for each range of occlusion."""
    return {
        "ranges": [list(each) for each in ranges],
        "counts": [int(within(occlusion, *each).sum()) for each in ranges],
        "rows": {
            metric: {
                method: by_occlusion(found[metric], occlusion, ranges, rng)
                for method, found in errors.items()
                if metric in found
            }
            for metric in METRICS
            if any(metric in found for found in errors.values())
        },
    }
