"""The paper's Table 1, and ours beside it.

Medians over images with at most 75 % of the object hidden, from P. Moreno et al., Overcoming Occlusion with
Inverse Graphics, ECCV 2016 Workshops. Its OpenGL images are our raster tier, its photorealistic ones our
Cycles tier.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

MAX_OCCLUSION = 0.75

BASELINE = {
    "azimuth_deg": 92.14,
    "elevation_deg": 14.44,
    "appearance": 0.140,
    "illumination": 0.021,
    "shape": 1.005,
}
"""Printed once, for both kinds of images. "shape" is in the paper's unit, which depends on its mesh."""

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
"""Our rows that the paper has, too: its shape by its own baseline's."""

COUNTERPARTS = {
    "baseline": "baseline",
    "rm": "rm",
    "gaussian": "gaussian",
    "robust": "robust",
    "spatial": "robust",
}
"""The paper's column beside which each of our methods is put."""


@dataclass(frozen=True)
class Cell:
    """One median of ours beside the paper's. counterpart: the paper's method. passed: ours is better."""

    tier: str
    metric: str
    method: str
    counterpart: str
    paper: float
    ours: float
    passed: bool


def paper_median(tier: str, metric: str, method: str) -> float | None:
    """The paper's number: tier "raster" or "cycles", a metric of `COMPARED`, a method among `COUNTERPARTS`'.

    None where the paper has none.
    """
    if metric == "shape_ratio":
        shape = paper_median(tier, "shape", method)
        return None if shape is None else shape / BASELINE["shape"]
    if method == "baseline":
        return BASELINE.get(metric)
    return _MODELS[tier][metric][("rm", "gaussian", "robust").index(method)]


def compare(table: Mapping[str, Any]) -> list[Cell]:
    """Each median of a table from `build_table` that the paper has, too, but for the baseline's.

    Raises ValueError for a table of another range of occlusion than the paper's.
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
            cells.append(Cell(table["tier"], metric, method, counterpart, paper, ours, passed))
    return cells
