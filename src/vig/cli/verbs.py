"""What each verb does; imported after the arguments are known, so that help is quick."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable
from typing import Any

from vig.cli import dataset as dataset_verbs
from vig.cli.common import check_writable
from vig.cli.main import Calibrate, Demo, Doctor, Evaluate, Fit, Reproduce, Train
from vig.errors import UserError


def run(settings: Any) -> int:
    """Do what a verb's settings say; returns the exit code."""
    work: dict[type, Callable[[Any], int]] = {
        Demo: demo,
        Fit: fit,
        **dict.fromkeys(dataset_verbs.VERBS, dataset_verbs.run),
        Train: train,
        Calibrate: calibrate,
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
        settings.object_class, settings.likelihood, settings.optimizer, not settings.no_self_shadow
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
    check_writable(settings.out)
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


def calibrate(settings: Calibrate) -> int:
    """`vig calibrate`."""
    from vig.cli.calibrating import calibrate as run_calibration

    return run_calibration(settings)


def evaluate(settings: Evaluate) -> int:
    """`vig evaluate`."""
    from vig.cli.evaluating import evaluate as run_evaluation

    return run_evaluation(settings)


def reproduce(settings: Reproduce) -> int:
    """`vig reproduce`."""
    from vig.cli.reproducing import reproduce_paper

    return reproduce_paper(settings)


def doctor(settings: Doctor) -> int:
    """`vig doctor`."""
    from vig.cli.doctor import run_doctor

    return run_doctor(settings.json)


def _line(name: str, described: dict[str, Any], seconds: float) -> str:
    hidden = described["hidden_fraction"]
    colour = ", ".join(f"{c:.2f}" for c in described["albedo"])
    return (
        f"{name}: azimuth {described['azimuth_deg']:.1f}, elevation {described['elevation_deg']:.1f} degrees,"
        f" albedo ({colour}), {'nothing seen' if hidden is None else f'{hidden:.0%} hidden'};"
        f" {described['verdict']}: {described['reason']} ({seconds:.1f} s)"
    )
