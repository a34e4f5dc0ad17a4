"""Every optimiser on the same photos: `python -m benchmarks.optimizers [--count N] [--json FILE]`.

One descent each, at full size, from the recognition model's best guess, one thread, kernels warm. The photos
are made by the raster generator (test split), or are the last ones of `--dataset DIR`. Prints a table: by how
many nats the end is lower than the best that any optimiser found for that photo, errors of azimuth, elevation
and shape, evaluations, milliseconds; medians, with the interquartile range behind +-.
"""

from __future__ import annotations

import argparse
import json
import platform
import re
import time
from pathlib import Path

import numpy as np
import scipy
import torch

from benchmarks.fit import metric
from vig import __version__
from vig.dataset import read_dataset
from vig.evaluation.metrics import angle_error_deg, shape_error_mm
from vig.inference import (
    BFGS,
    LBFGS,
    Alternating,
    Annealed,
    Budget,
    ConjugateGradient,
    Dogleg,
    ExplainSettings,
    GradientDescent,
    LevenbergMarquardt,
    Optimizer,
    objective_of,
)
from vig.recognition import Recognizer
from vig.scene import Latents, ObjectClass, linear_from_srgb
from vig.synthesis import render, sample

OPTIMIZERS: dict[str, tuple[Optimizer, Budget]] = {
    "lm": (LevenbergMarquardt(), Budget(50)),
    "dogleg": (Dogleg(), Budget(50)),
    "lbfgs": (LBFGS(), Budget(200)),
    "bfgs": (BFGS(), Budget(200)),
    "cg": (ConjugateGradient(), Budget(50)),
    "cg, unscaled (the paper's)": (ConjugateGradient(scaled=False), Budget(50)),
    "gd": (GradientDescent(), Budget(500)),
    "gd, decay 0.01": (GradientDescent(decay=0.01), Budget(500)),
    "gd, no momentum": (GradientDescent(momentum=0.0), Budget(500)),
    "lm, annealed": (Annealed(LevenbergMarquardt()), Budget(75)),
    "dogleg, annealed": (Annealed(Dogleg()), Budget(75)),
    "lbfgs, annealed": (Annealed(LBFGS()), Budget(300)),
    "cg, annealed": (Annealed(ConjugateGradient()), Budget(75)),
    "lm, closed form first": (Alternating(LevenbergMarquardt(), descended=50), Budget(54)),
    "lm, closed form in turns": (Alternating(LevenbergMarquardt()), Budget(60)),
    "lm, annealed, closed forms": (
        Annealed(Alternating(LevenbergMarquardt(), descended=25)),
        Budget(87),
    ),
}
COLUMNS = {
    "short_of_best": "nats",
    "azimuth": "deg",
    "elevation": "deg",
    "shape": "mm",
    "evaluations": "evaluations",
    "fit": "ms",
}
START = "start"


def made(object_class: ObjectClass, count: int, seed: int) -> tuple[np.ndarray, torch.Tensor]:
    """Photos (N, H, W, 3) uint8 and latents (N, P) of the test split's scenes."""
    specs = [sample(object_class, seed, index, "test") for index in range(count)]
    images = np.stack([render(spec, object_class).image for spec in specs])
    return images, torch.tensor(np.stack([spec.latents() for spec in specs]), dtype=torch.float32)


def read(folder: Path, split: str, count: int) -> tuple[np.ndarray, torch.Tensor]:
    """The last `count` photos and latents of a dataset; the last thousand of a training set validate."""
    dataset = read_dataset(folder, split)
    chosen = range(max(0, len(dataset) - count), len(dataset))
    return dataset.read("rgb", chosen), torch.from_numpy(dataset.latents[chosen.start :])


def measure(object_class: ObjectClass, images: np.ndarray, truth: torch.Tensor) -> dict[str, np.ndarray]:
    """What each optimiser reached: name to (N, columns), in the order of `COLUMNS`."""
    torch.set_num_threads(1)
    settings = ExplainSettings()
    photos = torch.from_numpy(linear_from_srgb(images.astype(np.float32) / 255)).float()
    prediction = Recognizer.of_class(object_class)(photos)
    zero, sigma = torch.zeros(1, dtype=torch.int32), settings.likelihood.sigma
    names = [START, *OPTIMIZERS]
    table = {name: np.zeros((len(photos), len(COLUMNS))) for name in names}
    for index, photo in enumerate(photos):
        objective = objective_of(photo, prediction[index : index + 1], object_class, settings)
        start = objective.point(prediction[index : index + 1].best())
        known = Latents.from_vector(truth[index : index + 1])
        first = objective(start, zero, torch.tensor([sigma])).value  # also compiles the kernels
        for name in names:
            began = time.perf_counter()
            points, value, evaluations = start, first, 1
            if name != START:
                optimizer, budget = OPTIMIZERS[name]
                end = optimizer(objective, start, zero, sigma, budget)
                points, value, evaluations = end.points, end.value, int(end.evaluations)
            spent = 1000 * (time.perf_counter() - began)
            found, model = objective.latents(points), object_class.shape_model
            table[name][index] = (
                float(value),
                *angle_error_deg(found.azimuth, known.azimuth),
                *angle_error_deg(found.elevation, known.elevation),
                *shape_error_mm(model.vertices(found.shape), model.vertices(known.shape)),
                evaluations,
                spent,
            )
    best = np.max([rows[:, 0] for rows in table.values()], axis=0)
    for rows in table.values():
        rows[:, 0] = best - rows[:, 0]
    return table


def main() -> None:
    """Measure, print, and write JSON where asked."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--count", type=int, default=100)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--dataset", type=Path)
    parser.add_argument("--split", default="test")
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    teapot = ObjectClass.load("teapot")
    if arguments.dataset is None:
        images, truth = made(teapot, arguments.count, arguments.seed)
    else:
        images, truth = read(arguments.dataset, arguments.split, arguments.count)
    table = measure(teapot, images, truth)
    head = [column if column == unit else f"{column} ({unit})" for column, unit in COLUMNS.items()]
    print("| optimiser | " + " | ".join(head) + " |\n" + "|---" * (1 + len(head)) + "|")
    metrics = []
    for name, rows in table.items():
        slug = re.sub(r"\W+", "_", name.split(" (")[0])
        found = [
            metric(
                f"{slug}_{column}" if column == unit else f"{slug}_{column}_{unit}",
                rows[:, place].tolist(),
                unit,
            )
            for place, (column, unit) in enumerate(COLUMNS.items())
        ]
        print(f"| {name} | " + " | ".join(f"{row['value']:.4g} +-{row['iqr']:.3g}" for row in found) + " |")
        metrics += found
    report = {
        "machine": {"processor": platform.machine(), "threads": 1},
        "versions": {
            "vig": __version__,
            "torch": torch.__version__,
            "scipy": scipy.__version__,
            "python": platform.python_version(),
        },
        "metrics": metrics,
    }
    if arguments.json:
        arguments.json.write_text(json.dumps(report, indent=2) + "\n")


if __name__ == "__main__":
    main()
