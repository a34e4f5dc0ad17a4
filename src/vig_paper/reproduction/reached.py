"""Results that runs of the tiny scale reach: they train on too little for the paper's numbers to be an aim.

`reached.json` has the medians of photos with at most 75 % of the object hidden, and how they were measured.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from vig_paper.settings import ReproductionSettings
from vig_train.evaluation.paper import compare
from vig_train.evaluation.presentation import TableBlock
from vig_train.evaluation.table import METRICS

RUNS = "three runs of this size, seeds 0 to 2, vig 0.3.0.dev0"
"""Origin of the numbers."""
REACHED: dict[str, dict[str, tuple[float, float]]] = json.loads(
    Path(__file__).with_name("reached.json").read_text()
)["medians"]
"""Least and largest median of these, by metric and method."""
SLACK = 1.5
"""A median may be so many times worse than the worst of them: each run by the other two passes 63 of 69."""
VARIED = ("seed", "methods", "cycles_images", "ablation_images")
"""Settings that another run of this size may have otherwise."""


@dataclass(frozen=True)
class ReachedMedian:
    """One median beside those of runs of the same size."""

    metric: str
    method: str
    least: float
    largest: float
    ours: float
    passed: bool
    """Ours is about as good, or better."""


def reached(settings: Mapping[str, Any], table: Mapping[str, Any]) -> list[ReachedMedian]:
    """Compare a table with those of runs of the same size; empty where none was measured.

    Args:
        settings: Settings of the run, from `ReproductionSettings.to_json`.
        table: Table of rasterised photos, as for `vig_train.evaluation.paper.compare`; others have none.
    """
    tiny = ReproductionSettings.of("tiny").to_json()
    if table["tier"] != "raster" or any(settings[name] != tiny[name] for name in tiny if name not in VARIED):
        return []
    medians = []
    for cell in compare(table):
        if cell.method not in REACHED[cell.metric]:
            continue
        least, largest = REACHED[cell.metric][cell.method]
        more = cell.metric == "segmentation_iou"
        passed = cell.ours >= least / SLACK if more else cell.ours <= largest * SLACK
        medians.append(ReachedMedian(cell.metric, cell.method, least, largest, cell.ours, passed))
    return medians


def reached_line(medians: list[ReachedMedian]) -> str:
    """Return how many of the medians are as good as those of runs of the same size."""
    passed = sum(median.passed for median in medians)
    return f"{passed} of {len(medians)} medians are as those of {RUNS}, or better"


def training_line(settings: Mapping[str, Any], photos: int) -> str:
    """Describe the training data of a run's recognition model; photos: how many there were."""
    if settings["weights"] is not None:
        return f"It took the given weights {settings['weights']} in place of a training."
    passes = (
        "as many passes as vig train makes" if settings["epochs"] is None else f"{settings['epochs']} passes"
    )
    return f"It trained on {photos:,} photos in {passes}; the paper's networks were trained on 10,000."


def reached_block(medians: list[ReachedMedian]) -> TableBlock:
    """Return the comparison for a terminal."""
    methods = list(dict.fromkeys(median.method for median in medians))
    cells = {
        (each.metric, each.method): f"{each.ours:.3g}\n{each.least:.3g} to {each.largest:.3g}:"
        f" {'ok' if each.passed else 'worse'}"
        for each in medians
    }
    metrics = dict.fromkeys(median.metric for median in medians)
    rows = [[METRICS[name], *(cells.get((name, method), "-") for method in methods)] for name in metrics]
    return TableBlock(f"Our medians, and what {RUNS} reached", ["", *methods], rows)
