"""The paper's Table 1, and ours beside it.

Medians over images with at most 75 % of the object hidden, from P. Moreno et al., Overcoming Occlusion with
Inverse Graphics, ECCV 2016 Workshops. Its OpenGL images correspond to our rasterised ones, its photorealistic
ones to our path-traced ones.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from vig_train.evaluation.presentation import TableBlock, metric_block

MAX_OCCLUSION = 0.75

BASELINE = {
    "azimuth_deg": 92.14,
    "elevation_deg": 14.44,
    "appearance": 0.140,
    "illumination": 0.021,
    "shape": 1.005,
}
"""The same for both kinds of images. "shape" is in the paper's unit, which depends on its mesh."""

_MODELS = {
    "raster": {
        "azimuth_deg": (10.68, 17.18, 8.55),
        "elevation_deg": (4.94, 7.57, 3.668),
        "appearance": (0.036, 0.055, 0.014),
        "illumination": (0.022, 0.024, 0.019),
        "shape": (0.525, 0.599, 0.479),
        "segmentation_iou": (0.670, None, 0.828),
    },
    "cycles": {
        "azimuth_deg": (11.71, 14.52, 11.17),
        "elevation_deg": (5.58, 8.19, 5.02),
        "appearance": (0.048, 0.056, 0.032),
        "illumination": (0.023, 0.024, 0.019),
        "shape": (0.541, 0.560, 0.511),
        "segmentation_iou": (0.659, None, 0.778),
    },
}
"""The recognition model, the Gaussian fit and the robust fit; None: not printed."""

COMPARED = ("azimuth_deg", "elevation_deg", "appearance", "illumination", "shape_ratio", "segmentation_iou")
"""Our rows that the paper has, too; "shape_ratio" is its shape divided by that of its baseline."""

COUNTERPARTS = {
    "baseline": "baseline",
    "rm": "rm",
    "gaussian": "gaussian",
    "robust": "robust",
    "spatial": "robust",
}
"""The paper's method with which each of ours is compared."""


@dataclass(frozen=True)
class MedianComparison:
    """One median of ours beside the paper's."""

    tier: str
    """The renderer, "raster" or "cycles", as in `table.json`."""
    metric: str
    method: str
    counterpart: str
    """The paper's method."""
    paper: float
    ours: float
    passed: bool
    """Ours is better."""


def paper_median(renderer: str, metric: str, method: str) -> float | None:
    """Return the paper's number, None where it has none.

    Args:
        renderer: "raster" or "cycles".
        metric: One of `COMPARED`.
        method: One of the values of `COUNTERPARTS`.
    """
    if metric == "shape_ratio":
        shape = paper_median(renderer, "shape", method)
        return None if shape is None else shape / BASELINE["shape"]
    if method == "baseline":
        return BASELINE.get(metric)
    return _MODELS[renderer][metric][("rm", "gaussian", "robust").index(method)]


def compare(table: Mapping[str, Any]) -> list[MedianComparison]:
    """Compare each median of a table from `build_table` that the paper has, too, without the baseline's.

    Raises:
        ValueError: The table is of another range of occlusion than the paper's.
    """
    limits = table.get("min_occlusion", 0.0), table["max_occlusion"]
    if limits != (0.0, MAX_OCCLUSION):
        raise ValueError(f"the paper's table is of occlusion 0 to {MAX_OCCLUSION}; got {limits}")
    cells = []
    for metric in COMPARED:
        for method, summary in table["rows"].get(metric, {}).items():
            counterpart = COUNTERPARTS.get(method, "baseline")
            paper, ours = paper_median(table["tier"], metric, counterpart), summary["median"]
            if paper is None or counterpart == "baseline":
                continue
            passed = ours > paper if metric == "segmentation_iou" else ours < paper
            cells.append(MedianComparison(table["tier"], metric, method, counterpart, paper, ours, passed))
    return cells


TITLES = {"raster": "rasterised photos (the paper's OpenGL)", "cycles": "path-traced photos (photorealistic)"}
"""Title of each renderer's photos."""


def comparison_block(table: Mapping[str, Any]) -> TableBlock:
    """Return a table from `summarise`, of the paper's range of occlusion, beside the paper's."""
    comparisons = {(cell.metric, cell.method): cell for cell in compare(table)}

    def cell(metric: str, method: str, summary: Mapping[str, Any]) -> str:
        low, high = summary["ci95"]
        text = f"{_digits(summary['median'])}\n[{_digits(low)}, {_digits(high)}]"
        if (compared := comparisons.get((metric, method))) is not None:
            text += f"\n{_digits(compared.paper)}: {'pass' if compared.passed else 'fail'}"
        return text

    title = (
        f"Table 1, {TITLES[table['tier']]}: medians over {table['count']} photos with at most"
        f" {table['max_occlusion']:.0%} of the object hidden, 95 % interval, the paper's number"
    )
    return metric_block(title, table["rows"], cell)


def _digits(value: float) -> str:
    """Format three significant digits, at most four decimals."""
    places = 4 if abs(value) < 0.1 else 3 if abs(value) < 1 else 2 if abs(value) < 10 else 1
    return f"{value:.{places}f}"
