"""The table of medians, and the further statistics."""

import json
from dataclasses import replace

import numpy as np
import pytest
from rich.console import Console

from vig.io.errors import UserError
from vig_train.evaluation.presentation import blocks, markdown, save_table
from vig_train.evaluation.protocol import MASK_HEAD
from vig_train.evaluation.table import METRICS, build_table, summarise
from vig_world.dataset import Dataset


def rng() -> np.random.Generator:
    return np.random.default_rng(7)


def small() -> dict:
    """Four images, the last one hidden too far."""
    results = {
        "baseline": {"azimuth_deg": [90.0, 100.0, 80.0, 1.0], "shape_mm": [10.0, 20.0, 40.0, 1.0]},
        "robust": {
            "azimuth_deg": [1.0, 2.0, 9.0, 1000.0],
            "shape_mm": [5.0, 1.0, 9.0, 1000.0],
            "segmentation_iou": [0.9, 0.8, 0.7, 0.0],
        },
    }
    return build_table(results, [0.0, 0.5, 0.75, 0.76], "raster", rng())


def test_only_images_within_the_limit_count_the_limit_included() -> None:
    table = small()
    assert (table["tier"], table["count"]) == ("raster", 3)
    assert (table["min_occlusion"], table["max_occlusion"]) == (0.0, 0.75), "the paper's limit by default"
    robust = table["rows"]["azimuth_deg"]["robust"]
    assert (robust["median"], robust["mean"]) == (2.0, 4.0)
    assert table["rows"]["segmentation_iou"].keys() == {"robust"}


def test_the_shape_ratio_is_taken_within_the_limit() -> None:
    # Medians 5 and 20 over the first three images.
    ratio = small()["rows"]["shape_ratio"]
    assert ratio["robust"]["median"] == 0.25
    assert (ratio["baseline"]["median"], ratio["baseline"]["ci95"]) == (1.0, [1.0, 1.0])


def test_no_ratio_without_a_baseline() -> None:
    table = build_table({"robust": {"shape_mm": [1.0]}}, [0.0], "raster", rng())
    assert table["rows"].keys() == {"shape_mm"}


def test_the_interval_has_the_width_of_theory() -> None:
    # The median of n standard normal draws has a standard error of sqrt(pi / 2 / n): for 2,000 images 0.028,
    # so the interval is 0.110 wide; the bootstrap's own scatter is some 10 %.
    errors = np.random.default_rng(3).normal(size=2000)
    summary = build_table({"m": {"azimuth_deg": errors}}, np.zeros(2000), "raster", rng())
    low, high = summary["rows"]["azimuth_deg"]["m"]["ci95"]
    assert low < summary["rows"]["azimuth_deg"]["m"]["median"] < high
    assert high - low == pytest.approx(2 * 1.96 * np.sqrt(np.pi / 2 / 2000), rel=0.25)


def test_the_same_seed_gives_the_same_table_whatever_the_other_methods() -> None:
    errors = np.random.default_rng(4).uniform(size=50)
    alone = build_table({"a": {"appearance": errors}}, np.zeros(50), "raster", rng())
    beside = build_table(
        {"b": {"appearance": errors**2}, "a": {"appearance": errors}}, np.zeros(50), "raster", rng()
    )
    assert alone["rows"]["appearance"]["a"] == beside["rows"]["appearance"]["a"]


def test_the_lower_limit_is_left_out() -> None:
    errors = {"rm": {"azimuth_deg": [1.0, 2.0, 4.0]}}
    table = build_table(errors, [0.0, 0.5, 0.6], "raster", rng(), min_occlusion=0.5)
    assert (table["count"], table["min_occlusion"]) == (1, 0.5)
    assert table["rows"]["azimuth_deg"]["rm"]["median"] == 4.0


def test_no_image_within_the_limit_is_the_users_error() -> None:
    with pytest.raises(UserError, match="at most 75% .* the lowest is 80%. Raise the limit"):
        build_table({}, [0.8, 0.9], "raster", rng())
    with pytest.raises(UserError, match="more than 30% and at most 75% .* they have from 10% to 90%"):
        build_table({}, [0.1, 0.9], "raster", rng(), min_occlusion=0.3)
    with pytest.raises(UserError, match="no images at all"):
        build_table({}, [], "raster", rng())


@pytest.mark.parametrize(
    ("metrics", "match"),
    [
        ({"azimut": [1.0]}, "unknown metric 'azimut' of 'rm'"),
        ({"shape_ratio": [1.0]}, "unknown metric 'shape_ratio'"),
        ({"azimuth_deg": [1.0, 2.0]}, r"expected one value per image \(1,\); got \(2,\)"),
        ({"azimuth_deg": [np.nan]}, "1 values are not finite"),
    ],
)
def test_misuse_is_refused(metrics: dict, match: str) -> None:
    with pytest.raises(ValueError, match=match):
        build_table({"rm": metrics}, [0.0], "raster", rng())


def test_the_table_has_every_part_and_is_json(results, dataset: Dataset, tmp_path) -> None:
    table = summarise(results, dataset, "raster", max_occlusion=1.0)
    save_table(tmp_path / "table.json", table, ())
    assert json.loads((tmp_path / "table.json").read_text()) == table
    fits = {"gaussian", "robust", "spatial"}
    assert set(table["failures"]) == {"baseline", "rm"} | fits
    assert set(table["verdicts"]) == fits and set(table["coverage"]) == {"rm"} | fits
    assert table["count"] == len(dataset) and MASK_HEAD in table["rows"]["segmentation_iou"]


def test_parts_are_of_the_images_within_the_limits(results, dataset: Dataset) -> None:
    least = float(np.median(dataset.occlusion))
    chosen = dataset.occlusion > least
    table = summarise(results, dataset, "raster", min_occlusion=least, max_occlusion=1.0)
    assert table["count"] == chosen.sum() == 2
    errors = results["rm"].errors["azimuth_deg"][chosen]
    assert table["failures"]["rm"]["count"] == (errors > 30).sum()
    assert sum(table["verdicts"]["robust"]["counts"].values()) == 2
    assert table["rows"]["azimuth_deg"]["rm"]["mean"] == pytest.approx(errors.mean())


def test_the_terminal_shows_every_cell_in_a_hundred_columns(results, dataset: Dataset) -> None:
    console = Console(width=100, color_system=None)
    table = summarise(results, dataset, "raster", max_occlusion=1.0)
    with console.capture() as captured:
        for block in blocks(table):
            console.print(block.rich())
    text = captured.get()
    assert "\u2026" not in text  # nothing cut short
    assert text.count("(") > 40 and "rm mask head" in text


def test_markdown() -> None:
    summary = {"median": 2.0, "mean": 4.0, "ci95": [1.0, 9.0]}
    low = {"median": 0.9, "mean": 0.85, "ci95": [0.0512, 0.95]}
    rows = {
        "azimuth_deg": {"rm": summary, "robust": summary},
        "segmentation_iou": {"robust": low, MASK_HEAD: low},
    }
    table = {"tier": "cycles", "count": 3, "max_occlusion": 0.75, "rows": rows}
    assert markdown(blocks(table)) == (
        "Table 1: cycles, 3 images, at most 75% hidden; median (mean), 95 % interval\n"
        "\n"
        "|  | rm | robust |\n"
        "| --- | ---: | ---: |\n"
        "| azimuth (degrees) | 2.00 (4.00)<br>[1.00, 9.00] | 2.00 (4.00)<br>[1.00, 9.00] |\n"
        "| segmentation (IoU, more is better) | - | 0.900 (0.850)<br>[0.051, 0.950] |\n"
        "| rm mask head (IoU) | 0.900 (0.850)<br>[0.051, 0.950] | - |\n"
    )


def test_titles_name_the_limits() -> None:
    table = {"tier": "raster", "count": 1, "max_occlusion": 0.9, "min_occlusion": 0.75}
    rows = {"azimuth_deg": {"rm": {"median": 0.0, "mean": 0.001, "ci95": [0.0, 123.4]}}}
    title, _, _, _, line, *_ = markdown(blocks(table | {"rows": rows})).splitlines()
    assert "1 images, 75% to 90% hidden" in title and "| 0 (0.0010)<br>[0, 123] |" in line
    assert line.startswith(f"| {METRICS['azimuth_deg']} ")


def test_a_summary_is_of_the_papers_images_unless_told(results, dataset: Dataset) -> None:
    hidden = replace(dataset, occlusion=np.array([0.1, 0.2, 0.75, 0.8], np.float32))
    assert (summarise(results, hidden, "raster")["count"]) == 3
