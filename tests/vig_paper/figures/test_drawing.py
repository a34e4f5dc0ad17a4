"""Images are chosen by rule."""

from types import SimpleNamespace

import numpy as np

from vig_paper.figures.drawing import choose, worst
from vig_train.evaluation.results import MethodResult

# Five images in the first bin, one in the third.
OCCLUSION = np.array([0.0, 0.05, 0.1, 0.12, 0.15, 0.4])


def results(**errors: list[float]) -> dict[str, MethodResult]:
    return {"robust": MethodResult({name: np.array(values) for name, values in errors.items()}, [""] * 6)}


def chosen(found: dict[str, MethodResult]) -> list[int]:
    return choose(found, SimpleNamespace(occlusion=OCCLUSION), "robust")


def test_a_bins_median_image_is_chosen() -> None:
    assert chosen(results(azimuth_deg=[5.0, 4.0, 1.0, 2.0, 3.0, 9.0])) == [4, 5]


def test_ranks_are_summed_over_the_papers_metrics_and_more_iou_is_better() -> None:
    # Ranks by azimuth 1 2 3 4 5, by IoU 1 2 4 3 5: best 0, median 2 and 3 tie (7 each), worst 4. The unit of
    # a metric does not count, nor does a metric that the paper has not.
    found = results(
        azimuth_deg=[1e-3, 2e-3, 3e-3, 4e-3, 5e3, 1.0],
        segmentation_iou=[0.9, 0.8, 0.6, 0.7, 0.1, 0.5],
        appearance_ab=[9.0, 8.0, 7.0, 6.0, 5.0, 4.0],
    )
    assert chosen(found) == [2, 5]


def test_the_worst_by_azimuth_come_first() -> None:
    assert worst(results(azimuth_deg=[5.0, 90.0, 1.0, 91.0, 3.0, 9.0]), "robust", 3) == [3, 1, 5]
