"""What each verb does; imported after the arguments are known, so that help is quick."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TimeElapsedColumn, TimeRemainingColumn

from vig.cli import dataset as dataset_verbs
from vig.cli.main import Demo, Doctor, Evaluate, Fit, Reproduce, Train
from vig.errors import UserError


def run(settings: Any) -> int:
    """Do what a verb's settings say; returns the exit code."""
    work: dict[type, Callable[[Any], int]] = {
        Demo: demo,
        Fit: fit,
        **dict.fromkeys(dataset_verbs.VERBS, dataset_verbs.run),
        Train: train,
        Evaluate: evaluate,
        Reproduce: reproduce,
        Doctor: doctor,
    }
    return work[type(settings)](settings)


def fit(settings: Fit) -> int:
    """`vig fit`."""
    from vig.cli.explaining import Explainer, parse_box, result_folders

    box = None if settings.box is None else parse_box(settings.box)
    folders = result_folders(settings.images, settings.out)
    explainer = Explainer(
        settings.object_class, settings.likelihood, settings.optimizer, settings.self_shadow
    )
    results, failures = {}, 0
    for image, folder in zip(settings.images, folders, strict=True):
        try:
            started = time.monotonic()
            described, _ = explainer(image, folder, box, settings.framing)
        except UserError as error:
            print(f"vig: {error}", file=sys.stderr)
            failures += 1
            continue
        results[str(image)] = described | {"folder": str(folder)}
        if not settings.json:
            print(_line(image.name, described, time.monotonic() - started))
    if settings.json:
        print(json.dumps({"results": results, "folder": str(settings.out)}, indent=2))
    elif results:
        print(settings.out)
    return 2 if failures else 0


def demo(settings: Demo) -> int:
    """`vig demo`."""
    from vig.cli.demonstration import demonstrate

    return demonstrate(settings.out, settings.json)


def train(settings: Train) -> int:
    """`vig train`."""
    from vig.dataset import read_dataset
    from vig.recognition import PaperTrainingSettings, TrainingSettings, train_paper
    from vig.recognition import train as train_network

    lines: list[str] = []
    say = lines.append if settings.json else lambda line: print(line, flush=True)
    dataset = read_dataset(settings.dataset, "train")
    _check_writable(settings.out)
    chosen: dict[str, Any] = {"seed": settings.seed}
    if settings.epochs is not None:
        chosen["epochs"] = settings.epochs
    if settings.net == "paper":
        path = train_paper(dataset, settings.out, PaperTrainingSettings(**chosen), say)
    else:
        path = train_network(dataset, settings.out, TrainingSettings(**chosen), say)
    if settings.json:
        print(json.dumps({"weights": str(path), "log": lines, "folder": str(settings.out)}))
    else:
        print(path)
        print(settings.out)
    return 0


def evaluate(settings: Evaluate) -> int:
    """`vig evaluate`."""
    from vig.dataset import read_dataset
    from vig.dataset.format import read_info
    from vig.evaluation import build_table, markdown_table, rich_table, save_table, write_csv
    from vig.evaluation import evaluate as run_methods
    from vig.files import atomic_write
    from vig.recognition import Recognizer
    from vig.scene import ObjectClass

    object_class = ObjectClass.load(settings.object_class)
    dataset = read_dataset(settings.dataset, settings.split)
    recognizer = Recognizer.of_class(object_class, settings.weights)
    if not 0 <= settings.max_occlusion <= 1:
        raise UserError(
            f"expected --max-occlusion as a share from 0 to 1; got {settings.max_occlusion:g}."
            " Is it a percentage?"
        )
    _check_writable(settings.out)
    fits = len(dataset) * sum(method in ("gaussian", "robust", "spatial") for method in settings.methods)
    with _progress(settings.json) as progress:
        task = progress.add_task("fits", total=fits)
        results = run_methods(
            dataset,
            object_class,
            recognizer,
            settings.methods,
            advance=lambda done: progress.advance(task, done),
            cache=settings.out / "fits",
        )
    write_csv(settings.out / "errors.csv", dataset, results)
    table = build_table(
        {method: result.errors for method, result in results.items()},
        dataset.occlusion,
        read_info(settings.dataset)["splits"][settings.split]["tier"],
        np.random.default_rng(0),
        settings.max_occlusion,
    )
    save_table(settings.out / "table.json", table)
    with atomic_write(settings.out / "table.md") as temporary:
        Path(temporary).write_text(markdown_table(table))
    if settings.json:
        print(json.dumps(table, indent=2))
        return 0
    Console(width=None if sys.stdout.isatty() else 140).print(rich_table(table))
    for method, result in results.items():
        said = np.array(result.verdicts)[dataset.occlusion <= settings.max_occlusion]
        counts = {name: int((said == name).sum()) for name in sorted(set(said.tolist())) if name}
        if counts:
            print(f"{method}: " + ", ".join(f"{count} {name}" for name, count in counts.items()))
        if "trusted" in counts:
            azimuth = result.errors["azimuth_deg"][dataset.occlusion <= settings.max_occlusion]
            share = (azimuth[said == "trusted"] < 15).mean()
            print(f"{method}: {share:.1%} of the trusted are within 15 degrees of azimuth")
    print(settings.out)
    return 0


def reproduce(settings: Reproduce) -> int:
    """`vig reproduce`."""
    from vig.cli.reproducing import reproduce_paper

    return reproduce_paper(settings)


def doctor(settings: Doctor) -> int:
    """`vig doctor`."""
    from vig.cli.doctor import run_doctor

    return run_doctor(settings.json)


def _check_writable(folder: Path) -> None:
    """Refuse now a folder that could not be written after an hour's work."""
    from vig.files import atomic_write

    probe = folder / ".writable"
    with atomic_write(probe) as temporary:
        temporary.touch()
    probe.unlink()


def _line(name: str, described: dict[str, Any], seconds: float) -> str:
    hidden = described["hidden_fraction"]
    colour = ", ".join(f"{c:.2f}" for c in described["albedo"])
    return (
        f"{name}: azimuth {described['azimuth_deg']:.1f}, elevation {described['elevation_deg']:.1f} degrees,"
        f" albedo ({colour}), {'nothing seen' if hidden is None else f'{hidden:.0%} hidden'};"
        f" {described['verdict']}: {described['reason']} ({seconds:.1f} s)"
    )


def _progress(quiet: bool) -> Progress:
    console = Console(stderr=True)
    return Progress(
        "{task.description}",
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
        console=console,
        disable=quiet or not console.is_terminal,
    )
