"""The page of a reproduction: tables beside the paper's, figures, and how it was made, in one HTML file.

A section is a list of parts, each a kind and its content: `page.html` says how each kind is shown.
"""

import base64
import csv
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader

from vig.io.errors import UserError
from vig.io.files import atomic_write
from vig_paper.ablation import ablation_blocks
from vig_paper.reproduction.folder import DATASETS, RENDERERS, RunFolder, duration, read_json
from vig_paper.reproduction.work import OCCLUSION_LIMITS
from vig_train.evaluation.paper import compare, comparison_block
from vig_train.evaluation.presentation import TableBlock, blocks
from vig_train.evaluation.table import METRICS
from vig_train.record import read_record
from vig_world.dataset.format import read_info

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
}

Part = tuple[str, Any]


def write_page(root: Path) -> Path:
    """Write `index.html` of a run's folder from its contents; missing contents are left out.

    Raises:
        UserError: The folder holds no run.
    """
    folder = RunFolder(root)
    record = read_record(folder.record)
    by_renderer = {name: folder.read_table(name) for name in RENDERERS}
    tables = {name: table for name, table in by_renderer.items() if table is not None}
    sections = [
        *((name, TITLES[name], _results(folder, name, table)) for name, table in tables.items()),
        ("ablations", "Ablations", _tables(folder.ablations, ablation_blocks)),
        ("training", "Training", _training(folder)),
        ("making", "How it was made", _making(folder, record)),
    ]
    templates = Environment(
        loader=FileSystemLoader(Path(__file__).parent), autoescape=True, trim_blocks=True, lstrip_blocks=True
    )
    page = templates.get_template("page.html").render(
        title="Overcoming Occlusion with Inverse Graphics, reproduced",
        introduction=_introduction(folder, record, tables),
        sections=[section for section in sections if section[2]],
    )
    with atomic_write(folder.page) as temporary:
        temporary.write_text(page, encoding="utf-8")
    return folder.page


def _introduction(folder: RunFolder, record: Mapping[str, Any], tables: Mapping[str, Any]) -> list[str]:
    """Describe the run, its amount of training, and how many cells of Table 1 pass."""
    settings = record["settings"]
    trained = [int(row[3]) for row in _photos(folder, record) if row[0] == "train"]
    lines = [
        "Section 5 of P. Moreno, C. K. I. Williams, C. Nash and P. Kohli (ECCV 2016 Workshops), run by vig at"
        f" the scale \u201c{settings['scale']}\u201d. A cell of Table 1 passes when our median is"
        " better than the paper's. The photos are vig's own; training and test photos share no asset.",
        training_line(settings, trained[0] if trained else settings["train_images"]),
    ]
    if settings["scale"] == "tiny":
        lines.append("So small a run checks that everything works; the paper's numbers are no aim for it.")
    for renderer, table in tables.items():
        cells = compare(table)
        passed = sum(cell.passed for cell in cells)
        failed: dict[str, list[str]] = {}
        for cell in cells:
            if not cell.passed:
                failed.setdefault(METRICS[cell.metric].split(" (")[0], []).append(cell.method)
        missed = "; ".join(f"{metric} ({', '.join(methods)})" for metric, methods in failed.items())
        line = f"{TITLES[renderer]}: {passed} of {len(cells)} cells pass."
        lines.append(f"{line} Not passed: {missed}." if missed else line)
    left_out = [TITLES[name].lower() for name in RENDERERS if name not in tables]
    return [*lines, f"This run has no {' and no '.join(left_out)}."] if left_out else lines


def _results(folder: RunFolder, renderer: str, table: Mapping[str, Any]) -> list[Part]:
    """Return tables and figures of a renderer's photos."""
    parts: list[Part] = [("table", block) for block in (comparison_block(table), *blocks(table)[1:])]
    for name, (least, most) in OCCLUSION_LIMITS.items():
        tables = [] if name == "table" else _tables(folder.tables(renderer) / f"{name}.json", blocks)
        parts += [("heading", f"{least:.0%} to {most:.0%} hidden"), *tables] if tables else []
    figures = folder.figures(renderer)
    parts += [("heading", "Figures")] if figures.exists() else []
    return parts + [part for name, caption in PICTURES.items() for part in _picture(figures / name, caption)]


def training_line(settings: Mapping[str, Any], photos: int) -> str:
    """Describe the training data of a run's recognition model; photos: how many there were."""
    if settings["weights"] is not None:
        return f"It took the given weights {settings['weights']} in place of a training."
    passes = (
        "as many passes as vig train makes" if settings["epochs"] is None else f"{settings['epochs']} passes"
    )
    return f"It trained on {photos:,} photos in {passes}; the paper's networks were trained on 10,000."


def _tables(path: Path, blocks_of: Any) -> list[Part]:
    """Return the blocks of a table in a file; none where there is no file."""
    table = read_json(path)
    return [] if table is None else [("table", block) for block in blocks_of(table)]


def _picture(path: Path, caption: str) -> list[Part]:
    """Return a PNG picture that becomes part of the page; none where there is no file."""
    if not path.exists():
        return []
    data = base64.b64encode(path.read_bytes()).decode()
    return [("picture", {"caption": caption, "url": f"data:image/png;base64,{data}"})]


def _training(folder: RunFolder) -> list[Part]:
    """Return the training's curve and the last line of its log; empty when weights were given."""
    reliability = "The network's predicted uncertainty on validation photos, before and after calibration."
    parts = _picture(folder.recognition / "losses.png", "The losses of the training, epoch by epoch.")
    parts += _picture(folder.recognition / "reliability.png", reliability)
    log = folder.recognition / "log.csv"
    if log.exists():
        with open(log, newline="") as file:
            names, *_, last_row = csv.reader(file)
        parts.append(
            _table("The last line of its log", [name.replace("_", " ") for name in names], [last_row])
        )
    return parts


def _making(folder: RunFolder, record: Mapping[str, Any]) -> list[Part]:
    """Return command, machine, photos, each step's time, and the settings but for the counts of photos."""
    machine = record["machine"]
    packages = ", ".join(f"{name} {version}" for name, version in machine.get("packages", {}).items())
    done = {name: step for name, step in record["steps"].items() if step["complete"]}
    steps = [
        [name, duration(step["seconds"]), str(step["sittings"]), step["finished"][:16].replace("T", " ")]
        for name, step in done.items()
    ]
    steps.append(["all", duration(sum(step["seconds"] for step in done.values())), "", ""])
    settings = [
        [name.replace("_", " "), ", ".join(value) if isinstance(value, list) else str(value)]
        for name, value in record["settings"].items()
        if value is not None and name not in {count for _, _, count in DATASETS.values()}
    ]
    return [
        ("command", record["command"]),
        (
            "paragraph",
            f"vig {record['vig']}, Python {machine.get('python')}, {machine.get('cpus')} x"
            f" {machine.get('processor')}, {machine.get('platform')}; {packages}.",
        ),
        _table("Photos", ["", "split", "renderer", "photos", "seed"], _photos(folder, record)),
        _table("Steps", ["", "time", "sittings", "finished (UTC)"], steps),
        _table("Settings", ["", ""], settings),
    ]


def _table(title: str, header: Sequence[str], rows: Sequence[Sequence[str]]) -> Part:
    return "table", TableBlock(title, header, rows)


def _photos(folder: RunFolder, record: Mapping[str, Any]) -> list[list[str]]:
    """Return name, split, renderer, count and seed of each dataset that exists."""
    rows = []
    for name, (split, _, _) in DATASETS.items():
        try:
            info = read_info(Path(record["settings"][name] or folder.data(name)))["splits"][split]
        except (UserError, KeyError):
            continue
        rows.append([name.replace("_", " "), split, *(str(info[key]) for key in ("tier", "count", "seed"))])
    return rows
