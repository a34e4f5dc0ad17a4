"""The lines of Figure 3 and of reliability are the numbers that they stand for."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from vig.scene import Latents
from vig_paper.figures import curves
from vig_paper.figures.curves import figure3, reliability_figure
from vig_train.evaluation.paper import paper_median
from vig_train.evaluation.results import MethodResult

OCCLUSION = np.array([0.05, 0.05, 0.05, 0.55, 0.85])
AZIMUTH = np.array([1.0, 2.0, 3.0, 10.0, 50.0])


def results() -> dict[str, MethodResult]:
    iou = np.full(5, 0.5)
    return {
        "rm": MethodResult({"azimuth_deg": AZIMUTH, "segmentation_iou": iou}, [""] * 5),
        "robust": MethodResult({"azimuth_deg": AZIMUTH / 10, "segmentation_iou": iou}, [""] * 5),
    }


def line(axes, number: int = 0) -> tuple[list[float], list[float]]:
    drawn = [each for each in axes.get_lines() if len(each.get_xdata()) > 1][number]
    return list(drawn.get_xdata()), list(drawn.get_ydata())


def test_cumulative_medians_and_the_papers_crosses(caught, tmp_path: Path) -> None:
    figures = caught(curves)
    path = figure3(results(), OCCLUSION, "cycles", tmp_path / "f.png")
    azimuth, *_, segmentation = figures[0].axes
    places, medians = line(azimuth)
    assert places == pytest.approx([10, 20, 30, 40, 50, 60, 70, 80, 90])
    # Three images up to 50 %, four to 80 %, five at 90.
    assert medians == [2, 2, 2, 2, 2, 2.5, 2.5, 2.5, 3]
    assert line(azimuth, 1)[1] == pytest.approx([0.2] * 5 + [0.25] * 3 + [0.3])
    crosses = [each.get_ydata()[0] for each in azimuth.get_lines() if len(each.get_xdata()) == 1]
    assert crosses == [paper_median("cycles", "azimuth_deg", method) for method in ("rm", "robust")]
    assert azimuth.get_yscale() == "log" and segmentation.get_yscale() == "linear"
    with Image.open(path) as image:
        assert image.width > 1000


def test_bins_without_images_are_left_out(caught, tmp_path: Path) -> None:
    figures = caught(curves)
    figure3(results(), OCCLUSION, "raster", tmp_path / "f.png", cumulative=False)
    assert line(figures[0].axes[0]) == (pytest.approx([7.5, 52.5, 82.5]), [2, 10, 50])
    assert all(len(each.get_xdata()) > 1 for each in figures[0].axes[0].get_lines())  # no crosses


def test_reliability_of_an_honest_method_is_the_diagonal(caught, tmp_path: Path) -> None:
    truth = np.random.default_rng(0).normal(size=(3000, 24)) * 0.3
    latents = Latents.from_vector(np.zeros((3000, 24)))
    honest = MethodResult({}, [""] * 3000, latents, np.full((3000, 24), 0.3))
    figures = caught(curves)
    reliability_figure({"baseline": MethodResult({}, []), "rm": honest}, truth, tmp_path / "r.png")
    (panel,) = figures[0].axes
    drawn = {each.get_label(): each for each in panel.get_lines()}
    for group in ("azimuth", "shape", "light"):
        # Of 3,000 draws the share within an interval has a standard error below 1 %.
        np.testing.assert_allclose(drawn[group].get_ydata(), drawn[group].get_xdata(), atol=3.0)


def test_nothing_stated_is_an_empty_figure(tmp_path: Path) -> None:
    assert reliability_figure({}, np.zeros((1, 24)), tmp_path / "r.png").is_file()
