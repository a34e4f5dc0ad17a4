"""Table 1 beside the paper's."""

from __future__ import annotations

from typing import Any

from vig_lab.evaluation.protocol import MASK_HEAD
from vig_lab.reproduction.comparison import Entry, comparison, comparison_block


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
    methods, rows = comparison(TABLE)
    assert methods == ["baseline", "rm", "robust"]
    azimuth, shape, segmentation, head = (cells for _, cells in rows)
    assert azimuth["baseline"] == Entry("90.0", "[45.0, 135.0]")
    assert azimuth["rm"] == Entry("12.0", "[6.00, 18.0]", "10.7", False)
    assert azimuth["robust"] == Entry("0.500", "[0.250, 0.750]", "8.55", True)
    assert shape["rm"].passed is None  # the paper's is in no unit
    assert not segmentation["rm"].passed and segmentation["robust"].passed  # more is better
    assert rows[-1][0] == "rm mask head (IoU)" and head == {"rm": Entry("0.800", "[0.400, 1.20]")}


def test_the_block_tells_pass_and_fail_in_words() -> None:
    text = comparison_block(TABLE).markdown()
    assert "| 0.500<br>[0.250, 0.750]<br>8.55: pass |" in text
    assert "| 12.0<br>[6.00, 18.0]<br>10.7: fail |" in text
    assert "9 photos with at most 75% of the object hidden" in text
