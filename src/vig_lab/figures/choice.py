"""Which images are shown: by rule, not by hand."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.stats import rankdata

from vig.dataset import Dataset
from vig_lab.evaluation.results import MethodResult
from vig_lab.evaluation.statistics import BINS, within
from vig_lab.evaluation.table import METRICS


def choose(
    results: Mapping[str, MethodResult], dataset: Dataset, method: str, quantiles: Sequence[float] = (0.5,)
) -> list[int]:
    """In each bin of occlusion, the images that stand at some quantiles of how well a method did there.

    In its bin every image is ranked by each of the paper's metrics, and then by the sum of these ranks: 0 is
    the best of the bin, 0.5 its median image, 1 its worst. Ties go to the earlier image. Returns indices in
    the order of the bins, each once; a bin without images gives none.
    """
    if not all(0 <= quantile <= 1 for quantile in quantiles):
        raise ValueError(f"quantiles must be from 0 to 1; got {tuple(quantiles)}")
    errors = results[method].errors
    chosen: list[int] = []
    for least, most in BINS:
        inside = np.flatnonzero(within(dataset.occlusion, least, most))
        if not len(inside):
            continue
        columns = {metric: errors[metric][inside] for metric in METRICS if metric in errors}
        signs = {"segmentation_iou": -1.0}  # more is better
        total = sum(rankdata(signs.get(metric, 1.0) * values) for metric, values in columns.items())
        order = inside[np.argsort(total, kind="stable")]
        chosen += [int(order[round(quantile * (len(order) - 1))]) for quantile in quantiles]
    return list(dict.fromkeys(chosen))


def worst(results: Mapping[str, MethodResult], method: str, count: int) -> list[int]:
    """The images whose azimuth a method has most wrong, the worst first."""
    errors = results[method].errors["azimuth_deg"]
    return [int(index) for index in np.argsort(-errors, kind="stable")[:count]]
