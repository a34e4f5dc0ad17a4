"""The page of a run whose tables are made up."""

import base64
import re
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from vig.io.errors import UserError
from vig.photo.images import write_png
from vig_paper.reproduction import RunFolder
from vig_paper.reproduction.page import training_line, write_page
from vig_paper.settings import ReproductionSettings
from vig_train.evaluation.presentation import save_table
from vig_train.evaluation.table import build_table
from vig_train.record import Record


class Balance(HTMLParser):
    """Fails when an element is closed that is not the last one opened; counts the elements."""

    def __init__(self) -> None:
        super().__init__()
        self.opened: list[str] = []
        self.counts: dict[str, int] = {}

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.counts[tag] = self.counts.get(tag, 0) + 1
        if tag not in {"meta", "img", "br"}:
            self.opened.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.opened.pop() == tag


METRICS = ("azimuth_deg", "elevation_deg", "appearance", "illumination", "shape_mm")


@pytest.fixture
def folder(tmp_path: Path) -> RunFolder:
    """A run with a figure and tables of the raster tier: the robust fit is better than the paper's, the
    recognition model is not."""
    folder = RunFolder(tmp_path)
    command = "vig reproduce --scale tiny --out <here>"
    record = Record.open(
        folder.record, ReproductionSettings.of("tiny", epochs=3), {"cpus": 2, "processor": "slow"}, command
    )
    for step in ("data train", "evaluate raster"):
        with record.time_step(step):
            pass
    sizes = {"baseline": 100.0, "rm": 90.0, "robust": 0.001}
    results = {method: {metric: np.full(8, size) for metric in METRICS} for method, size in sizes.items()}
    for name, limits in (("table", (0.0, 0.75)), ("table_75_90", (0.75, 0.9))):
        middle = np.full(8, sum(limits) / 2)
        table = build_table(
            results, middle, "raster", np.random.default_rng(0), limits[1], 10, min_occlusion=limits[0]
        )
        save_table(folder.tables("raster") / f"{name}.json", table, ())
    write_png(folder.figures("raster") / "figure3.png", np.zeros((4, 4, 3), np.uint8))
    return folder


def test_the_page_has_what_the_run_has_and_nothing_else(folder: RunFolder) -> None:
    assert write_page(folder.root) == folder.page
    text = folder.page.read_text()
    page = Balance()
    page.feed(text)
    assert page.opened == [] and page.counts["img"] == page.counts["h1"] == 1
    assert page.counts["section"] == page.counts["a"] == 2
    assert not {"script", "link"} & set(page.counts) and "http" not in text
    picture = re.search(r'src="data:image/png;base64,([^"]+)"', text)
    drawn = folder.figures("raster") / "figure3.png"
    assert picture and base64.b64decode(picture[1]) == drawn.read_bytes()
    assert "Rasterised photos" in text and "This run has no path-traced photos." in text
    assert "75% to 90% hidden" in text
    for absent in ("Ablations", "Training", "worst first"):
        assert absent not in text
    assert "vig reproduce --scale tiny --out &lt;here&gt;" in text and "2 x slow" in text
    assert "evaluate raster" in text and "figures raster" not in text


def test_passing_cells_are_counted_and_failing_ones_named(folder: RunFolder) -> None:
    """Five metrics of the paper for each of two methods: all of the robust fit pass, none of the other."""
    write_page(folder.root)
    text = folder.page.read_text()
    assert "Rasterised photos: 5 of 10 cells pass." in text
    named = ("azimuth", "elevation", "appearance", "illumination", "shape / mean shape")
    assert f"Not passed: {'; '.join(f'{metric} (rm)' for metric in named)}." in text
    assert text.count("<b>pass</b>") == text.count("<b>fail</b>") == 5


def test_what_it_was_trained_on_is_said(folder: RunFolder) -> None:
    write_page(folder.root)
    text = folder.page.read_text()
    assert "It trained on 200 photos in 3 passes; the paper" in text
    assert "So small a run checks that everything works" in text


def test_what_a_run_trained_on() -> None:
    paper = ReproductionSettings.of("paper").to_json()
    assert "10,000 photos in as many passes as vig train makes" in training_line(paper, 10000)
    given = ReproductionSettings.of("tiny", weights=Path("w.safetensors")).to_json()
    assert training_line(given, 200) == "It took the given weights w.safetensors in place of a training."


def test_a_folder_without_a_run_is_told(tmp_path: Path) -> None:
    with pytest.raises(UserError, match=r"expected the record of a run at .*run\.json"):
        write_page(tmp_path)
    assert not list(tmp_path.iterdir())
