"""Statistics of per-image errors: medians with intervals, failures, tests, coverage of uncertainties."""

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from vig.scene import Latents, angle_difference, layout_of_width
from vig_train.evaluation.results import MethodResult

OCCLUSION_LEVELS = tuple(number / 10 for number in range(1, 10))
"""The paper's levels of occlusion: a median is over all images with at most this share hidden."""
OCCLUSION_BINS = ((0.0, 0.15), (0.15, 0.3), (0.3, 0.45), (0.45, 0.6), (0.6, 0.75), (0.75, 0.9))
"""Separate ranges of occlusion."""
FAR_DEG = 30.0  # a fit whose azimuth is off by more has failed
NEAR_DEG = 15.0  # a fit called trusted should have its azimuth within this

Summary = dict[str, Any]


def within_occlusion(occlusion: np.ndarray, least: float, most: float) -> np.ndarray:
    """Return which of N images have an occlusion above `least`, or from 0 where that is 0, up to `most`."""
    occlusion = np.asarray(occlusion, dtype=np.float64)
    return ((occlusion > least) | (least == 0)) & (occlusion <= most)


def bootstrap_indices(count: int, rng: np.random.Generator, resamples: int = 1000) -> np.ndarray:
    """Return bootstrap samples of `count` images: indices (resamples, count)."""
    return rng.integers(0, count, (resamples, count))


def interval(estimates: np.ndarray) -> list[float]:
    """Return the percentile bootstrap's 95 % interval of estimates (R,), one of each resample."""
    low, high = np.percentile(estimates, [2.5, 97.5])
    return [float(low), float(high)]


def summary(values: np.ndarray, resamples: np.ndarray) -> Summary:
    """Return the median, mean, and the median's interval ("ci95") of values (N,) under resamples (R, N)."""
    return {
        "median": float(np.median(values)),
        "mean": float(values.mean()),
        "ci95": interval(np.median(values[resamples], axis=1)),
    }


def by_occlusion(
    values: np.ndarray,
    occlusion: np.ndarray,
    ranges: Sequence[tuple[float, float]],
    rng: np.random.Generator,
) -> list[Summary | None]:
    """Return a summary of values (N,) for each range (least, most) of occlusion; None without images."""
    summaries: list[Summary | None] = []
    for least, most in ranges:
        chosen = values[within_occlusion(occlusion, least, most)]
        indices = bootstrap_indices(len(chosen), rng, 300) if len(chosen) else None
        summaries.append(None if indices is None else summary(chosen, indices))
    return summaries


def failure_rate(azimuth_deg: np.ndarray, resamples: np.ndarray) -> dict[str, Any]:
    """Return how many of N azimuth errors exceed `FAR_DEG`: "count", "rate", and the rate's interval."""
    far = azimuth_deg > FAR_DEG
    return {"count": int(far.sum()), "rate": float(far.mean()), "ci95": interval(far[resamples].mean(axis=1))}


def paired_difference(later: np.ndarray, earlier: np.ndarray, resamples: np.ndarray) -> dict[str, Any]:
    """Compare two methods' values (N,) of the same images, first less second.

    Returns:
        "median_difference" of the medians and "mean_difference" of the means, each with the paired
        bootstrap's interval; "p": two-sided Wilcoxon signed-rank test of the differences, 1 without any.
    """
    from scipy.stats import wilcoxon  # imported here: it takes half a second

    medians = [np.median(values[resamples], axis=1) for values in (later, earlier)]
    difference = later - earlier
    return {
        "median_difference": float(np.median(later) - np.median(earlier)),
        "ci95": interval(medians[0] - medians[1]),
        "mean_difference": float(difference.mean()),
        "mean_ci95": interval(difference[resamples].mean(axis=1)),
        "p": float(wilcoxon(difference).pvalue) if difference.any() else 1.0,
    }


def latent_groups(count: int) -> dict[str, list[int]]:
    """Return columns of a vector of `count` latents, by group; each number is a group, too, as `light_1`.

    The light's first, L00, is in none: exposure fixes it, so that its error is always 0.
    """
    layout = layout_of_width(count)
    groups = {name: layout.indices(name) for name in ("azimuth", "elevation", "shape", "albedo", "light")}
    groups["light"] = groups["light"][1:]
    single = {
        f"{name}_{column - layout.at(name)}": [column]
        for name in ("shape", "albedo", "light")
        for column in groups[name]
    }
    return groups | single


def standardised_errors(result: MethodResult, truth: np.ndarray) -> np.ndarray:
    """Return errors (N, P) in units of the standard deviations that a method predicts; truth (N, P) latents.

    Azimuth differences are taken on the circle, between views that look the same. Where the deviation is 0,
    the result is 0 or infinite.
    """
    if result.latents is None or result.deviation is None:
        raise ValueError("expected a method with latents and their deviations; got one without")
    true = result.symmetry.nearest(Latents.from_vector(truth), result.latents.azimuth)
    error = result.latents.to_vector().astype(np.float64) - true.to_vector()
    azimuth = layout_of_width(truth.shape[1]).at("azimuth")
    error[:, azimuth] = angle_difference(error[:, azimuth], np.zeros(1))
    without_deviation = np.where(error == 0, 0.0, np.inf)
    deviation = result.deviation.astype(np.float64)
    return np.where(deviation > 0, np.abs(error) / np.where(deviation > 0, deviation, 1.0), without_deviation)


def coverage(standard: np.ndarray, nominal: float = 0.9) -> dict[str, float]:
    """Return the share of truths within the predicted Gaussian's central interval of probability `nominal`.

    standard (N, P) from `standardised_errors`. By group, see `latent_groups`, whose latents are pooled.
    """
    from scipy.stats import norm

    covered = standard <= norm.ppf((1 + nominal) / 2)  # 1.645 for 90 %
    return {
        name: float(covered[:, columns].mean()) for name, columns in latent_groups(covered.shape[1]).items()
    }


def by_kind(
    results: Mapping[str, MethodResult], kinds: Mapping[str, np.ndarray], truth: np.ndarray
) -> dict[str, dict[str, Any]]:
    """Return statistics by kind of image and method; kinds: the images (N,) bool of each; truth (N, P).

    That is the number of images, the azimuth's median error and its share within 15 degrees, the median IoU
    of the visible pixels, the `coverage` of azimuth and elevation, and for fits the `verdicts`.
    """
    posed = {method: result for method, result in results.items() if "segmentation_iou" in result.errors}
    standard = {m: standardised_errors(r, truth) for m, r in posed.items() if r.deviation is not None}
    summaries: dict[str, dict[str, Any]] = {}
    for kind, of_kind in kinds.items():
        for method, result in posed.items():
            azimuth = result.errors["azimuth_deg"][of_kind]
            held = coverage(standard[method][of_kind]) if method in standard else {}
            summaries.setdefault(kind, {})[method] = {
                "count": int(of_kind.sum()),
                "azimuth_deg": float(np.median(azimuth)),
                "within_15_deg": float((azimuth <= NEAR_DEG).mean()),
                "segmentation_iou": float(np.median(result.errors["segmentation_iou"][of_kind])),
                "coverage": {name: held[name] for name in ("azimuth", "elevation") if name in held},
                "verdicts": verdicts(result, of_kind) if any(result.verdicts) else None,
            }
    return summaries


def quarters_hidden(occlusion: np.ndarray, chosen: np.ndarray) -> dict[str, np.ndarray]:
    """Return by name the images (N,) bool of quarters of those `chosen` (N,) bool, by the share hidden.

    Ends of equal share go to the lower quarter; a quarter without images is left out.
    """
    ends = np.quantile(occlusion[chosen], [0.0, 0.25, 0.5, 0.75, 1.0])
    quarters = {}
    for number, (least, most) in enumerate(pairwise(ends.tolist())):
        within = chosen & (occlusion <= most) & ((occlusion > least) | (number == 0))
        if within.any():
            name = f"{least:.0%} to {most:.0%} hidden"
            quarters[name if name not in quarters else f"{least:.2%} to {most:.2%} hidden"] = within
    return quarters


def verdicts(result: MethodResult, chosen: np.ndarray) -> dict[str, Any]:
    """Return how often each verdict was given among images `chosen` (N,) bool, and how reliable "trusted" is.

    Returns:
        "counts": verdict to number; "trusted_share" of the images; "trusted_within_15_deg": the share of the
        trusted ones whose azimuth error is at most 15 degrees, None when there are none.
    """
    names = np.array(result.verdicts)[chosen]
    trusted = result.errors["azimuth_deg"][chosen][names == "trusted"]
    return {
        "counts": {name: int((names == name).sum()) for name in sorted(set(names.tolist()))},
        "trusted_share": len(trusted) / len(names),
        "trusted_within_15_deg": float((trusted <= NEAR_DEG).mean()) if len(trusted) else None,
    }


def expected_calibration_error(confidence: np.ndarray, right: np.ndarray) -> float | None:
    """Return the expected calibration error (Naeini et al. 2015) of N confidences in [0, 1], or None.

    Over ten equal bins of confidence, the mean difference between it and the share that is right (N,) bool,
    weighted by the photos in each. Photos without a confidence (NaN) do not count; None where all are so.
    """
    known = np.isfinite(confidence)
    if not known.any():
        return None
    gaps = np.bincount(np.minimum(10 * confidence[known], 9).astype(int), (confidence - right)[known], 10)
    return float(np.abs(gaps).sum() / known.sum())
