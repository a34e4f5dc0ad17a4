"""Every figure of an evaluation in one folder, and the rules by which its images are chosen."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from scipy.stats import rankdata

from vig.scene import ObjectClass
from vig_paper.figures.curves import figure3, reliability_figure
from vig_paper.figures.photos import figure4, figure5
from vig_paper.figures.style import last_fit
from vig_train.evaluation.results import MethodResult
from vig_train.evaluation.statistics import OCCLUSION_BINS, within_occlusion
from vig_train.evaluation.table import METRICS
from vig_world.dataset import Dataset


def draw_figures(
    dataset: Dataset,
    object_class: ObjectClass,
    results: Mapping[str, MethodResult],
    renderer: str,
    folder: Path,
) -> list[Path]:
    """Write the figures that the results allow.

    figure3.png, figure3_bins.png: errors against occlusion, cumulative and in bins. figure4.png, figure5.png:
    the last fit's median image of each bin of occlusion, see `choose`.
    figure4_worst.png: its images of largest azimuth error. reliability.png: methods that predict deviations.

    Args:
        dataset: The images.
        object_class: Class of the objects.
        results: Results of the methods.
        renderer: Renderer of the images, "raster" or "cycles".
        folder: Folder to write to.

    Returns:
        The paths.
    """
    paths = [
        figure3(results, dataset.occlusion, renderer, folder / "figure3.png"),
        figure3(results, dataset.occlusion, renderer, folder / "figure3_bins.png", cumulative=False),
    ]
    method = last_fit(results)
    if method is None:
        return paths
    chosen, wrong = choose(results, dataset, method), worst(results, method, 8)
    paths += [
        reliability_figure(results, dataset.latents, folder / "reliability.png"),
        figure4(dataset, object_class, results, chosen, folder / "figure4.png"),
        figure4(dataset, object_class, results, wrong, folder / "figure4_worst.png"),
        figure5(dataset, results, chosen, folder / "figure5.png"),
    ]
    return paths


def choose(results: Mapping[str, MethodResult], dataset: Dataset, method: str) -> list[int]:
    """Choose the image of median errors of a method in each bin of occlusion.

    In its bin every image is ranked by each of the paper's metrics, and then by the sum of these ranks. Ties
    go to the earlier image.

    Returns:
        Indices in the order of the bins; a bin without images has none.
    """
    errors = results[method].errors
    chosen: list[int] = []
    for least, most in OCCLUSION_BINS:
        inside = np.flatnonzero(within_occlusion(dataset.occlusion, least, most))
        if not len(inside):
            continue
        columns = {metric: errors[metric][inside] for metric in METRICS if metric in errors}
        signs = {"segmentation_iou": -1.0}  # more is better
        total = sum(rankdata(signs.get(metric, 1.0) * values) for metric, values in columns.items())
        order = inside[np.argsort(total, kind="stable")]
        chosen.append(int(order[round((len(order) - 1) / 2)]))
    return chosen


def worst(results: Mapping[str, MethodResult], method: str, count: int) -> list[int]:
    """Return the images of largest azimuth error, the worst first."""
    errors = results[method].errors["azimuth_deg"]
    return [int(index) for index in np.argsort(-errors, kind="stable")[:count]]
