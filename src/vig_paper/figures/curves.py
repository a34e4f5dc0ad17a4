"""Figure 3: errors against occlusion. Reliability: predicted against observed coverage."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from vig_paper.figures.style import COLOURS, FAINT, INK, NAMES, SOFT, new_figure, save, style_axes
from vig_train.evaluation.paper import MAX_OCCLUSION, paper_median
from vig_train.evaluation.results import MethodResult
from vig_train.evaluation.statistics import (
    OCCLUSION_BINS,
    OCCLUSION_LEVELS,
    by_occlusion,
    coverage,
    standardised_errors,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

PANEL_TITLES = {
    "azimuth_deg": "azimuth error, degrees",
    "elevation_deg": "elevation error, degrees",
    "appearance": "appearance error",
    "illumination": "illumination error",
    "shape_mm": "shape error, mm",
    "segmentation_iou": "segmentation, IoU (more is better)",
}
GROUP_COLOURS = {
    "azimuth": "#3b6fb6",
    "elevation": "#2f9e6e",
    "shape": "#c2357b",
    "albedo": "#e08a2e",
    "light": "#8a63c7",
}
_LINE: dict[str, Any] = {"linewidth": 1.7, "linestyle": "-", "marker": "o", "markersize": 3}
_DASHED: dict[str, Any] = {"linestyle": (0, (4, 2)), "zorder": 3}
_LEGEND: dict[str, Any] = {"loc": "outside upper left", "frameon": False, "fontsize": 9, "labelcolor": INK}
NOMINAL_COVERAGES = np.array([0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 0.99])


def figure3(
    results: Mapping[str, MethodResult],
    occlusion: np.ndarray,
    renderer: str,
    path: str | Path,
    cumulative: bool = True,
) -> Path:
    """Write six panels of median error against occlusion, a line for each method with its 95 % band.

    Args:
        results: Results of the methods on N images.
        occlusion: (N,) in [0, 1].
        renderer: Renderer of the images, "raster" or "cycles".
        path: Path of the picture.
        cumulative: Medians over all images with at most this occlusion, as in the paper, whose own medians at
            75 % are crosses; otherwise over separate bins.
    """
    from matplotlib.lines import Line2D

    ranges = [(0.0, level) for level in OCCLUSION_LEVELS] if cumulative else list(OCCLUSION_BINS)
    places = [100 * (most if cumulative else (least + most) / 2) for least, most in ranges]
    figure = new_figure(12, 7)
    panels = figure.subplots(2, 3)
    # Dashes over "spatial", whose line may be the same as that of "robust".
    lines = {
        method: _LINE | {"color": COLOURS[method]} | (_DASHED if method == "robust" else {})
        for method in results
    }
    for axes, (metric, title) in zip(panels.flat, PANEL_TITLES.items(), strict=True):
        for method, result in results.items():
            if metric not in result.errors:
                continue
            rng = np.random.default_rng(0)  # the same resamples for every line
            summaries = by_occlusion(result.errors[metric], occlusion, ranges, rng)
            rows = [
                (place, summary["median"], *summary["ci95"])
                for place, summary in zip(places, summaries, strict=True)
                if summary is not None
            ]
            occlusions, median, low, high = np.array(rows).reshape(-1, 4).T
            axes.fill_between(occlusions, low, high, color=COLOURS[method], alpha=0.15, linewidth=0)
            axes.plot(occlusions, median, **lines[method])
            if cumulative and method in ("rm", "gaussian", "robust") and metric != "shape_mm":
                paper = paper_median(renderer, metric, method)  # whose shape is in another unit
                if paper is not None:
                    cross = {"color": COLOURS[method], "markersize": 7, "markeredgewidth": 1.8}
                    axes.plot(100 * MAX_OCCLUSION, paper, "x", **cross)
        style_axes(axes, title)
        axes.set_xlim(0, 90)
        axes.set_xticks(range(0, 91, 15))
        if metric == "segmentation_iou":
            axes.set_ylim(0, 1)
        else:
            _logarithmic(axes)
    for axes in panels[1]:
        label = "occlusion at most, %" if cumulative else "occlusion, % (bins of 15)"
        axes.set_xlabel(label, color=SOFT, fontsize=9)
    handles = [Line2D([], [], **lines[method]) for method in results]
    labels = [NAMES.get(method, method) for method in results]
    if cumulative:
        handles.append(Line2D([], [], color=SOFT, marker="x", linestyle="", markersize=7))
        labels.append("the paper, at 75 %")
    title = f"{len(occlusion):,} {renderer} images; median and its 95 % interval"
    heading: dict[str, Any] = {"title": title, "alignment": "left", "title_fontproperties": {"size": 11}}
    figure.legend(handles, labels, ncols=len(labels), **_LEGEND, **heading)
    return save(figure, path)


def reliability_figure(
    results: Mapping[str, MethodResult], truth_vector: np.ndarray, path: str | Path
) -> Path:
    """Write how often truths lie within predicted intervals, against the intervals' probability.

    A panel for each method that predicts deviations, a line for each group of latents; truth_vector (N, P).
    """
    uncertain = {method: result for method, result in results.items() if result.deviation is not None}
    figure = new_figure(3.3 * max(len(uncertain), 1) + 0.4, 3.9)
    panels = figure.subplots(1, max(len(uncertain), 1), squeeze=False, sharey=True)[0]
    for axes, (method, result) in zip(panels, uncertain.items(), strict=False):
        standard = standardised_errors(result, truth_vector)
        coverages = [coverage(standard, nominal) for nominal in NOMINAL_COVERAGES]
        axes.plot([0, 100], [0, 100], color=SOFT, linewidth=0.8, linestyle=(0, (2, 2)))
        # Where truths should lie: 85 to 95 % of them within the predicted 90 % intervals.
        axes.fill_between([88, 92], 85, 95, color=FAINT, linewidth=0, label="aim at 90 %")
        for group, colour in GROUP_COLOURS.items():
            observed = [100 * shares[group] for shares in coverages]
            axes.plot(100 * NOMINAL_COVERAGES, observed, label=group, **_LINE | {"color": colour})
        style_axes(axes, NAMES.get(method, method))
        axes.set_xlim(0, 100)
        axes.set_ylim(0, 101)
        axes.set_aspect("equal")
        axes.set_xlabel("predicted, %", color=SOFT, fontsize=9)
    if uncertain:
        panels[0].set_ylabel("observed, %", color=SOFT, fontsize=9)
        handles, labels = panels[0].get_legend_handles_labels()
        figure.legend(handles, labels, ncols=6, **_LEGEND)
    return save(figure, path)


def _logarithmic(axes: "Axes") -> None:
    """Make a logarithmic axis with plain numbers."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    axes.set_yscale("log")
    low, high = axes.get_ylim()
    steps = (1.0,) if high > 100 * low else (1.0, 2.0, 5.0)
    axes.yaxis.set_major_locator(LogLocator(subs=steps, numticks=20))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.yaxis.set_minor_formatter(NullFormatter())
