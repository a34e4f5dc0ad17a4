"""The whole table, and how it is shown."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
from rich.console import Console

from vig.dataset import Dataset
from vig_lab.evaluation import METRICS, blocks, markdown_table, save_table, summarise
from vig_lab.evaluation.protocol import MASK_HEAD
from vig_lab.evaluation.statistics import BINS, LEVELS


def test_the_table_has_every_part_and_is_json(results, dataset: Dataset, tmp_path) -> None:
    table = summarise(results, dataset, "raster", max_occlusion=1.0)
    save_table(tmp_path / "table.json", table)
    assert json.loads((tmp_path / "table.json").read_text()) == table
    fits = {"gaussian", "robust", "spatial"}
    assert set(table["failures"]) == {"baseline", "rm"} | fits
    assert set(table["verdicts"]) == fits and set(table["coverage"]) == {"rm"} | fits
    pairs = {(test["method"], test["against"]) for test in table["tests"]}
    assert len(pairs) == 6 and not any(MASK_HEAD in pair or "baseline" in pair for pair in pairs)
    assert sum(table["bins"]["counts"]) == len(dataset) == table["count"]
    assert len(table["levels"]["counts"]) == len(LEVELS) and table["levels"]["counts"][-1] == len(dataset)
    assert len(table["bins"]["rows"]["azimuth_deg"]["robust"]) == len(BINS)
    assert MASK_HEAD in table["bins"]["rows"]["segmentation_iou"]


def test_parts_are_of_the_images_within_the_limits(results, dataset: Dataset) -> None:
    least = float(np.median(dataset.occlusion))
    chosen = dataset.occlusion > least
    table = summarise(results, dataset, "raster", min_occlusion=least, max_occlusion=1.0)
    assert table["count"] == chosen.sum() == 2
    errors = results["rm"].errors["azimuth_deg"][chosen]
    assert table["failures"]["rm"]["count"] == (errors > 30).sum()
    assert sum(table["verdicts"]["robust"]["counts"].values()) == 2
    test = next(t for t in table["tests"] if t["metric"] == "azimuth_deg" and t["method"] == "robust")
    difference = results["robust"].errors["azimuth_deg"][chosen] - errors
    np.testing.assert_allclose(test["mean_difference"], difference.mean())


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
    assert markdown_table(table) == (
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
    title, _, _, _, line, *_ = markdown_table(table | {"rows": rows}).splitlines()
    assert "1 images, 75% to 90% hidden" in title and "| 0 (0.0010)<br>[0, 123] |" in line
    assert line.startswith(f"| {METRICS['azimuth_deg']} ")


def test_a_summary_is_of_the_papers_images_unless_told(results, dataset: Dataset) -> None:
    hidden = replace(dataset, occlusion=np.array([0.1, 0.2, 0.75, 0.8], np.float32))
    assert (summarise(results, hidden, "raster")["count"]) == 3
