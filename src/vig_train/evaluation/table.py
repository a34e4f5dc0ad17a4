"""Everything reported of methods on a dataset, from per-image errors, as one table ready for JSON."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from vig.io.errors import UserError
from vig_train.evaluation.metrics import shape_ratio
from vig_train.evaluation.results import MethodResult
from vig_train.evaluation.statistics import (
    bootstrap_indices,
    by_kind,
    coverage,
    failure_rate,
    interval,
    quarters_hidden,
    standardised_errors,
    summary,
    verdicts,
    within_occlusion,
)
from vig_world.dataset import Dataset

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
"""The method that predicts the training mean for every image; its shape is the unit of `shape_ratio`."""


def build_table(
    results: Mapping[str, Mapping[str, Any]],
    occlusion: Any,
    renderer: str,
    rng: np.random.Generator,
    max_occlusion: float = 0.75,
    resamples: int = 1000,
    min_occlusion: float = 0.0,
) -> dict[str, Any]:
    """Summarise errors over all images whose occlusion is within limits; see
    `statistics.within_occlusion`.

    Args:
        results: Method -> metric -> (N,) finite errors, in any of `METRICS` but "shape_ratio", which follows
            from "shape_mm" where there is a method "baseline"; any may be missing.
        occlusion: (N,) in [0, 1].
        renderer: Renderer of the images, "raster" or "cycles".
        rng: Draws the bootstrap samples.
        max_occlusion: Largest occlusion of the images that count.
        resamples: Number of bootstrap samples.
        min_occlusion: Least occlusion of the images that count.

    Returns:
        `{"tier", "count", "max_occlusion", "min_occlusion", "rows": {metric: {method: {"median", "mean",
        "ci95"}}}}`: plain numbers, ready for JSON; "tier" is the renderer. ci95 is the percentile bootstrap
        interval of the median, from the same samples for every method and metric.

    Raises:
        ValueError: Unknown metrics, lengths that differ, values that are not finite.
        UserError: No image is within the limits.
    """
    occlusion = np.asarray(occlusion, dtype=np.float64)
    chosen = within_occlusion(occlusion, min_occlusion, max_occlusion)
    count = int(chosen.sum())
    check_limits(occlusion, min_occlusion, max_occlusion)
    errors = {
        method: {metric: _check_values(method, metric, values, chosen) for metric, values in metrics.items()}
        for method, metrics in results.items()
    }
    samples = bootstrap_indices(count, rng, resamples)
    mean_shape_error = errors.get(BASELINE, {}).get("shape_mm")
    rows: dict[str, dict[str, Any]] = {}
    for metric in METRICS:
        for method, values in errors.items():
            if metric in values:
                summarised = summary(values[metric], samples)
            elif metric == "shape_ratio" and mean_shape_error is not None and "shape_mm" in values:
                shape = values["shape_mm"]
                medians = np.median(shape[samples], axis=1) / np.median(mean_shape_error[samples], axis=1)
                summarised = summary(shape_ratio(shape, mean_shape_error), samples) | {
                    "ci95": interval(medians)
                }
            else:
                continue
            rows.setdefault(metric, {})[method] = summarised
    return {
        "tier": renderer,
        "count": count,
        "max_occlusion": max_occlusion,
        "min_occlusion": min_occlusion,
        "rows": rows,
    }


def summarise(
    results: Mapping[str, MethodResult],
    dataset: Dataset,
    renderer: str,
    min_occlusion: float = 0.0,
    max_occlusion: float = 0.75,
    seed: int = 0,
) -> dict[str, Any]:
    """Compute `build_table` of the images within the limits of occlusion, and further statistics.

    Args:
        results: Results of each method.
        dataset: Their images.
        renderer: Renderer of the images.
        min_occlusion: Least occlusion of the images that count.
        max_occlusion: Largest occlusion of the images that count.
        seed: Seed of the bootstrap.

    Returns:
        The table, with "failures": method to `statistics.failure_rate`; "verdicts": method to
        `statistics.verdicts`; "coverage": method to group of latents to the share of truths within the
        predicted 90 % interval; "kinds": see `statistics.by_kind`, by quarters of the hidden share and, for
        photographs, by the object's covering.

    Raises:
        UserError: No image is within the limits.
    """
    rng = np.random.default_rng(np.random.SeedSequence(seed))
    errors = {method: result.errors for method, result in results.items()}
    table = build_table(
        errors, dataset.occlusion, renderer, rng, max_occlusion=max_occlusion, min_occlusion=min_occlusion
    )
    chosen = within_occlusion(dataset.occlusion, min_occlusion, max_occlusion)
    samples = bootstrap_indices(table["count"], rng)
    posed = {method: result for method, result in results.items() if "azimuth_deg" in result.errors}
    uncertain = {method: result for method, result in results.items() if result.deviation is not None}
    kinds = quarters_hidden(dataset.occlusion, chosen)
    if dataset.world != "paper":
        finish = np.array(dataset.finish)
        kinds |= {name: chosen & (finish == name) for name in sorted(set(finish[chosen].tolist()))}
    return table | {
        "failures": {m: failure_rate(r.errors["azimuth_deg"][chosen], samples) for m, r in posed.items()},
        "verdicts": {m: verdicts(r, chosen) for m, r in posed.items() if any(r.verdicts)},
        "kinds": by_kind(posed, kinds, dataset.latents),
        "coverage": {
            m: coverage(standardised_errors(r, dataset.latents)[chosen]) for m, r in uncertain.items()
        },
    }


def check_limits(occlusion: np.ndarray, least: float, most: float) -> None:
    """Raise UserError when none of the images is within the limits of occlusion."""
    if within_occlusion(occlusion, least, most).any():
        return
    if not occlusion.size:
        got, remedy = "there are no images at all", "Use another dataset."
    elif least == 0:
        got, remedy = f"the lowest is {occlusion.min():.0%}", "Raise the limit or use another dataset."
    else:
        got = f"they have from {occlusion.min():.0%} to {occlusion.max():.0%}"
        remedy = "Change the limits or use another dataset."
    limits = f"at most {most:.0%}" if least == 0 else f"more than {least:.0%} and at most {most:.0%}"
    raise UserError(f"expected images with {limits} of the object hidden; {got}. {remedy}")


def _check_values(method: str, metric: str, values: Any, chosen: np.ndarray) -> np.ndarray:
    array = np.asarray(values, dtype=np.float64)
    if metric == "shape_ratio" or metric not in METRICS:
        expected = ", ".join(name for name in METRICS if name != "shape_ratio")
        raise ValueError(f"unknown metric {metric!r} of {method!r}; expected one of {expected}")
    if array.shape != chosen.shape:
        raise ValueError(f"{method} {metric}: expected one value per image {chosen.shape}; got {array.shape}")
    if not np.isfinite(array).all():
        raise ValueError(f"{method} {metric}: {np.count_nonzero(~np.isfinite(array))} values are not finite")
    return array[chosen]
