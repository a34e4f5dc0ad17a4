"""A tiny run beside others of its size."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from vig_paper.reproduction.reached import REACHED, reached, reached_block, reached_line, training_line
from vig_paper.settings import ReproductionSettings

TINY = ReproductionSettings.of("tiny").to_json()


def table(factor: float = 1.0, tier: str = "raster") -> dict[str, Any]:
    """The worst of the runs that were measured, errors and IoU times a factor."""
    rows = {
        metric: {
            method: {"median": factor * (least if metric == "segmentation_iou" else largest)}
            for method, (least, largest) in methods.items()
        }
        for metric, methods in REACHED.items()
    }
    return {"tier": tier, "max_occlusion": 0.75, "rows": rows}


def test_the_runs_that_were_measured_pass_by_their_own_numbers() -> None:
    medians = reached(TINY, table())
    assert len(medians) == 23 and all(median.passed for median in medians)
    assert reached_line(medians).startswith("23 of 23 medians are as those of three runs of this size")


def test_errors_of_twice_the_worst_and_half_the_iou_are_worse() -> None:
    twice = {(median.metric, median.method): median.passed for median in reached(TINY, table(2.0))}
    assert {metric for (metric, _), passed in twice.items() if passed} == {"segmentation_iou"}
    half = {(median.metric, median.method): median.passed for median in reached(TINY, table(0.5))}
    assert {metric for (metric, _), passed in half.items() if not passed} == {"segmentation_iou"}


@pytest.mark.parametrize(
    "changed",
    [{"epochs": 3}, {"train_images": 201}, {"test_images": 21}, {"net": "paper"}, {"weights": Path("w")},
     {"test_raster": Path("d")}],
)  # fmt: skip
def test_runs_of_other_numbers_are_judged_by_the_paper(changed: dict[str, Any]) -> None:
    assert reached(ReproductionSettings.of("tiny", **changed).to_json(), table()) == []


def test_seeds_methods_and_path_traced_photos_change_nothing_but_these_were_not_measured() -> None:
    settings = ReproductionSettings.of("tiny", seed=7, methods=("rm",), cycles_images=3).to_json()
    assert reached(settings, table()) and reached(settings, table(tier="cycles")) == []


def test_what_a_run_trained_on() -> None:
    assert training_line(TINY, 200) == (
        "It trained on 200 photos in 2 passes; the paper's networks were trained on 10,000."
    )
    paper = ReproductionSettings.of("paper").to_json()
    assert "10,000 photos in as many passes as vig train makes" in training_line(paper, 10000)
    given = ReproductionSettings.of("tiny", weights=Path("w.safetensors")).to_json()
    assert training_line(given, 200) == "It took the given weights w.safetensors in place of a training."


def test_the_block_has_a_row_for_each_metric() -> None:
    block = reached_block(reached(TINY, table(2.0)))
    assert block.header == ["", "rm", "gaussian", "robust", "spatial"] and len(block.rows) == len(REACHED)
    azimuth, *_, segmentation = block.rows
    assert azimuth[:2] == ["azimuth (degrees)", "193\n53.2 to 96.7: worse"] and segmentation[2] == "-"
