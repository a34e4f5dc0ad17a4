"""The paper's numbers, and ours beside them."""

from typing import Any

import pytest

from vig_train.evaluation.paper import (
    COMPARED,
    COUNTERPARTS,
    compare,
    comparison_block,
    paper_median,
)
from vig_train.evaluation.protocol import MASK_HEAD


def table(tier: str, **limits: float) -> dict:
    """Ours is 0.5 throughout, of every method and the mask head."""
    methods = [*COUNTERPARTS, "rm mask head"]
    rows = {metric: {method: {"median": 0.5} for method in methods} for metric in COMPARED}
    return {
        "tier": tier,
        "max_occlusion": 0.75,
        "rows": rows | {"shape_mm": {"rm": {"median": 1.0}}},
    } | limits


@pytest.mark.parametrize(("tier", "robust", "iou"), [("raster", 0.477, 0.828), ("cycles", 0.508, 0.778)])
def test_shape_is_compared_by_the_ratio_to_the_mean_shape(tier: str, robust: float, iou: float) -> None:
    assert paper_median(tier, "shape_ratio", "robust") == pytest.approx(robust, abs=5e-4)
    assert paper_median(tier, "shape_ratio", "baseline") == 1
    assert paper_median(tier, "segmentation_iou", "robust") == iou
    assert paper_median(tier, "segmentation_iou", "gaussian") is None
    assert paper_median(tier, "segmentation_iou", "baseline") is None


def test_lower_errors_pass_and_a_higher_iou() -> None:
    cells = {(cell.metric, cell.method): cell for cell in compare(table("raster"))}
    assert cells["azimuth_deg", "robust"].passed and cells["azimuth_deg", "robust"].paper == 8.55
    assert not cells["appearance", "robust"].passed
    assert not cells["shape_ratio", "robust"].passed  # 0.5 against 0.477
    assert cells["shape_ratio", "gaussian"].passed
    assert not cells["segmentation_iou", "robust"].passed
    passes = {cell.metric: cell.passed for cell in compare(table("cycles")) if cell.method == "robust"}
    assert passes["shape_ratio"] and not passes["segmentation_iou"]


def test_every_cell_has_its_counterpart() -> None:
    cells = compare(table("cycles"))
    assert len(cells) == 6 + 5 + 6 + 6  # the paper has no Gaussian mask
    spatial = [cell for cell in cells if cell.method == "spatial"]
    robust = [cell for cell in cells if cell.method == "robust"]
    assert [cell.paper for cell in spatial] == [cell.paper for cell in robust]
    assert {cell.counterpart for cell in spatial} == {"robust"}
    assert {(cell.tier, cell.ours) for cell in cells} == {("cycles", 0.5)}


def test_a_tie_is_no_pass() -> None:
    ours = table("raster")
    ours["rows"]["azimuth_deg"]["rm"]["median"] = 10.68
    assert not next(
        cell for cell in compare(ours) if (cell.metric, cell.method) == ("azimuth_deg", "rm")
    ).passed


@pytest.mark.parametrize("limits", [{"max_occlusion": 0.9}, {"min_occlusion": 0.5}])
def test_other_images_than_the_papers_are_refused(limits: dict) -> None:
    with pytest.raises(ValueError, match="occlusion 0 to 0.75"):
        compare(table("raster", **limits))


def summary(median: float) -> dict[str, Any]:
    return {"median": median, "mean": 2 * median, "ci95": [0.5 * median, 1.5 * median]}


TABLE = {
    "tier": "raster",
    "count": 9,
    "min_occlusion": 0.0,
    "max_occlusion": 0.75,
    "rows": {
        "azimuth_deg": {"baseline": summary(90.0), "rm": summary(12.0), "robust": summary(0.5)},
        "shape_mm": {"rm": summary(4.0)},
        "segmentation_iou": {"rm": summary(0.6), "robust": summary(0.9), MASK_HEAD: summary(0.8)},
    },
}
"""PAPER, OpenGL: azimuth 10.68 and 8.55, segmentation 0.670 and 0.828 (recognition model, robust fit)."""


def test_each_cell_stands_beside_the_papers() -> None:
    block = comparison_block(TABLE)
    assert block.header == ["", "baseline", "rm", "robust"]
    azimuth, shape, segmentation, head = block.rows
    assert azimuth[1:3] == ["90.0\n[45.0, 135.0]", "12.0\n[6.00, 18.0]\n10.7: fail"]
    assert azimuth[3] == "0.500\n[0.250, 0.750]\n8.55: pass"
    assert shape[1:] == ["-", "4.00\n[2.00, 6.00]", "-"]  # the paper's is in no unit
    assert segmentation[2].endswith("fail") and segmentation[3].endswith("pass")  # more is better
    assert head == ["rm mask head (IoU)", "-", "0.800\n[0.400, 1.20]", "-"]


def test_the_block_tells_pass_and_fail_in_words() -> None:
    text = comparison_block(TABLE).markdown()
    assert "| 0.500<br>[0.250, 0.750]<br>8.55: pass |" in text
    assert "| 12.0<br>[6.00, 18.0]<br>10.7: fail |" in text
    assert "9 photos with at most 75% of the object hidden" in text
