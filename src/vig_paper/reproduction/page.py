"""The page of a reproduction: tables beside the paper's, figures, and how it was made, in one HTML file."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from vig.io.errors import UserError
from vig_paper.ablation import ablation_blocks
from vig_paper.reproduction.html import HtmlCell, heading, listing, paragraph, picture, table, write_html
from vig_paper.reproduction.reached import RUNS, ReachedMedian, reached, reached_line, training_line
from vig_paper.reproduction.run import duration
from vig_paper.reproduction.settings import DATASETS, RENDERERS, RunFolder, read_json
from vig_paper.reproduction.work import OCCLUSION_LIMITS
from vig_train.evaluation import METRICS
from vig_train.evaluation.paper import ComparisonCell, compare, comparison, comparison_title
from vig_train.evaluation.presentation import TableBlock, blocks
from vig_train.record import read_record
from vig_world.dataset.format import read_info

TITLE = "Overcoming Occlusion with Inverse Graphics, reproduced"
TITLES = {"raster": "Rasterised photos", "cycles": "Path-traced photos"}
PICTURES = {
    "photos.png": "Test photos, from unoccluded to hidden; the object's hidden part is tinted.",
    "figure3.png": "Figure 3: median errors over all photos by the largest share of the object hidden.",
    "figure3_bins.png": "The same over separate ranges of occlusion.",
    "figure4.png": "Figure 4: photos and their explanations; of each range of occlusion the photo of median"
    " error.",
    "figure5.png": "Figure 5: the true and the fitted light of the same photos.",
    "figure4_worst.png": "The photos of largest azimuth error, the worst first.",
    "reliability.png": "How often the truth lies within predicted intervals; on the diagonal they are"
    " calibrated.",
    "fit.webp": "A fit, evaluation by evaluation.",
}
COUNTS = ("train_images", "validation_images", "test_images", "cycles_images")
"""Settings left out of their table, since the table of photos has the counts."""


def write_page(root: Path) -> Path:
    """Write `index.html` of a run's folder from its contents; what does not exist yet is left out.

    Raises:
        UserError: The folder holds no run.
    """
    folder = RunFolder(root)
    record = read_record(folder.record)
    by_renderer = {name: folder.read_table(name) for name in RENDERERS}
    tables = {name: table_data for name, table_data in by_renderer.items() if table_data is not None}
    results = [
        (name, TITLES[name], _results(folder, name, table_data, reached(record["settings"], table_data)))
        for name, table_data in tables.items()
    ]
    write_html(
        folder.page,
        TITLE,
        _introduction(folder, record, tables),
        [
            *results,
            ("ablations", "Ablations", _ablations(folder)),
            ("training", "Training", _training(folder)),
            ("making", "How it was made", _making(folder, record)),
        ],
    )
    return folder.page


def _introduction(folder: RunFolder, record: Mapping[str, Any], tables: Mapping[str, Any]) -> str:
    """What was run, on how much it was trained, and how many cells of Table 1 pass.

    A run too small for that is put beside others of its size first.
    """
    settings = record["settings"]
    text = paragraph(
        "Section 5 of P. Moreno, C. K. I. Williams, C. Nash and P. Kohli (ECCV 2016 Workshops), run by vig at"
        f" the scale \u201c{settings['scale']}\u201d. A cell of Table 1 passes when our median is"
        " better than the paper's. The photos are vig's own; training and test photos share no asset."
    )
    trained = [int(cells[2]) for name, cells in _photos(folder, record) if name == "train"]
    text += paragraph(training_line(settings, trained[0] if trained else settings["train_images"]))
    for renderer, table_data in tables.items():
        cells = compare(table_data)
        passed = sum(cell.passed for cell in cells)
        if medians := reached(settings, table_data):
            text += paragraph(
                f"{TITLES[renderer]}: {reached_line(medians)}. So small a run checks that everything works;"
                f" the paper's numbers are no aim for it: {passed} of {len(cells)} are better than these."
            )
            continue
        failed: dict[str, list[str]] = {}
        for cell in cells:
            if not cell.passed:
                failed.setdefault(METRICS[cell.metric].split(" (")[0], []).append(cell.method)
        missed = "; ".join(f"{metric} ({', '.join(methods)})" for metric, methods in failed.items())
        line = f"{TITLES[renderer]}: {passed} of {len(cells)} cells pass."
        text += paragraph(f"{line} Not passed: {missed}." if missed else line)
    left_out = [TITLES[name].lower() for name in RENDERERS if name not in tables]
    return text + (paragraph(f"This run has no {' and no '.join(left_out)}.") if left_out else "")


def _results(
    folder: RunFolder, renderer: str, table_data: Mapping[str, Any], medians: list[ReachedMedian]
) -> str:
    """Tables and figures of a renderer's photos; medians: those beside which ours are judged, if any."""
    methods, rows = comparison(table_data)
    of_size = {(METRICS[median.metric], median.method): median for median in medians}
    cells = [
        (title, [_cell(row.get(method), of_size.get((title, method))) for method in methods])
        for title, row in rows
    ]
    beside = f"; judged by what {RUNS} reached" if medians else ""
    html = table(comparison_title(table_data) + beside, ["", *methods], cells)
    for block in blocks(table_data)[1:]:  # the first is Table 1 without the paper's numbers
        html += _block(block)
    for name, (least, most) in OCCLUSION_LIMITS.items():
        occluded_table = folder.read_table(renderer, name) if name != "table" else None
        if occluded_table is not None:
            html += heading(f"{least:.0%} to {most:.0%} hidden")
            html += "".join(_block(block) for block in blocks(occluded_table))
    if folder.figures(renderer).exists():
        html += heading("Figures")
    return html + "".join(picture(folder.figures(renderer) / name, text) for name, text in PICTURES.items())


def _cell(entry: ComparisonCell | None, median: ReachedMedian | None) -> HtmlCell:
    if entry is None:
        return HtmlCell("\u2013")
    below = f"{entry.interval}\npaper {entry.paper}" if entry.paper else entry.interval
    if median is not None:
        return HtmlCell(entry.median, f"{below}\nsuch runs {median.text}", median.passed, median.word)
    return HtmlCell(entry.median, below, entry.passed)


def _block(block: TableBlock) -> str:
    """A table of the evaluation; the second line of a cell is set smaller below the first."""
    rows = [(row[0], [_two_lines(cell) for cell in row[1:]]) for row in block.rows]
    return table(block.title, [name.replace("\n", " ") for name in block.header], rows)


def _two_lines(text: str) -> HtmlCell:
    above, _, below = text.partition("\n")
    return HtmlCell(above, below)


def _ablations(folder: RunFolder) -> str:
    """The fit with each part of the method switched off."""
    table_data = read_json(folder.ablations)
    return "" if table_data is None else "".join(_block(block) for block in ablation_blocks(table_data))


def _training(folder: RunFolder) -> str:
    """The training's curve and the last line of its log; empty when weights were given."""
    log = folder.recognition / "log.csv"
    html = picture(folder.recognition / "losses.png", "The losses of the training, epoch by epoch.")
    caption = "The network's predicted uncertainty on validation photos, before and after calibration."
    html += picture(folder.recognition / "reliability.png", caption)
    if log.exists():
        with open(log, newline="") as file:
            names, *_, last_row = csv.reader(file)
        html += table(
            "The last line of its log",
            [name.replace("_", " ") for name in names],
            [(last_row[0], last_row[1:])],
        )
    return html


def _making(folder: RunFolder, record: Mapping[str, Any]) -> str:
    """Command, machine, photos, settings, and the time of each step."""
    machine = record["machine"]
    packages = ", ".join(f"{name} {version}" for name, version in machine.get("packages", {}).items())
    html = listing([record["command"]])
    html += paragraph(
        f"vig {record['vig']}, Python {machine.get('python')}, {machine.get('cpus')} x"
        f" {machine.get('processor')}, {machine.get('platform')}; {packages}."
    )
    done = {name: step for name, step in record["steps"].items() if step["complete"]}
    steps = [
        (name, [duration(step["seconds"]), str(step["sittings"]), step["finished"][:16].replace("T", " ")])
        for name, step in done.items()
    ]
    steps.append(("all", [duration(sum(step["seconds"] for step in done.values())), "", ""]))
    html += table("Photos", ["", "split", "renderer", "photos", "seed"], _photos(folder, record))
    html += table("Steps", ["", "time", "sittings", "finished (UTC)"], steps)
    settings = [
        (name.replace("_", " "), [", ".join(value) if isinstance(value, list) else str(value)])
        for name, value in record["settings"].items()
        if value is not None and name not in COUNTS
    ]
    return html + table("Settings", ["", ""], settings)


def _photos(folder: RunFolder, record: Mapping[str, Any]) -> list[tuple[str, list[str]]]:
    """Split, renderer, count and seed of each dataset that exists."""
    rows = []
    for name, (split, _) in DATASETS.items():
        try:
            split_info = read_info(Path(record["settings"][name] or folder.data(name)))["splits"][split]
        except (UserError, KeyError):
            continue
        rows.append(
            (name.replace("_", " "), [split, *(str(split_info[key]) for key in ("tier", "count", "seed"))])
        )
    return rows
