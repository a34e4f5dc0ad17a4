"""Every optimiser on the same photos: `python -m benchmarks.optimizers [--count N] [--json FILE]`.

One descent each, at full size, from the recognition model's best guess, one thread, kernels warm. The photos
are made by the raster generator (test split), or are the last ones of `--dataset DIR`. Prints a table: by how
many nats the end is lower than the best that any optimiser found for that photo, errors of azimuth, elevation
and shape, evaluations, milliseconds; medians, with the interquartile range behind +-. Then, for each row, how
its time and its final objective compare with the default's on the same photos: a fit's stages run
Levenberg-Marquardt at falling noise, so that row is the default's.
"""

from __future__ import annotations

import argparse
import re
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch

from benchmarks import photos
from benchmarks.report import median_interval, metric, report, write
from vig.dataset.metrics import angle_error_deg, shape_error_mm
from vig.inference import ExplainSettings, objective_of
from vig.optimizers.annealing import Annealed
from vig.optimizers.bfgs import BFGS
from vig.optimizers.closed_form import Alternating
from vig.optimizers.conjugate_gradient import ConjugateGradient
from vig.optimizers.dogleg import Dogleg
from vig.optimizers.gradient_descent import GradientDescent
from vig.optimizers.lbfgs import LBFGS
from vig.optimizers.levenberg_marquardt import LevenbergMarquardt
from vig.optimizers.optimizer import Budget, Optimizer
from vig.recognition import Recognizer
from vig.scene import Latents, ObjectClass

DEFAULT = "lm, annealed (the default)"

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
    DEFAULT: (Annealed(LevenbergMarquardt()), Budget(75)),
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


def measure(object_class: ObjectClass, images: torch.Tensor, truth: torch.Tensor) -> dict[str, np.ndarray]:
    """What each optimiser reached: name to (N, columns), in the order of `COLUMNS`."""
    torch.set_num_threads(1)
    settings = ExplainSettings()
    prediction = Recognizer.of_class(object_class)(images)
    zero, sigma = torch.zeros(1, dtype=torch.int32), settings.likelihood.sigma
    names = [START, *OPTIMIZERS]
    table = {name: np.zeros((len(images), len(COLUMNS))) for name in names}
    for index, photo in enumerate(images):
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


@dataclass(frozen=True)
class Comparison:
    """One optimiser beside the default on the same photos.

    time: median of the ratios of times. gain: median of how many nats its end is higher than the default's;
    low, high: the 95 % bootstrap interval of that median.
    """

    time: float
    gain: float
    low: float
    high: float

    @property
    def verdict(self) -> str:
        """What the interval says of the final objective."""
        if self.low > 0:
            return "better"
        return "worse" if self.high < 0 else "neither better nor worse"

    @property
    def default_wins(self) -> bool:
        """The default takes less time, and its final objective is not shown to be lower."""
        return self.time > 1 and self.low <= 0

    def __str__(self) -> str:
        return (
            f"{self.time:.2f} x the default's time; final objective {self.verdict}:"
            f" {self.gain:+.4g} nats (95 % {self.low:+.4g} to {self.high:+.4g})"
        )


def compare(table: Mapping[str, np.ndarray]) -> dict[str, Comparison]:
    """Each row of `measure`'s table, but the start and the default, beside the default."""
    short, spent = list(COLUMNS).index("short_of_best"), list(COLUMNS).index("fit")
    default, found = table[DEFAULT], {}
    for name, rows in table.items():
        if name not in (START, DEFAULT):
            gains = default[:, short] - rows[:, short]
            ratio = float(np.median(rows[:, spent] / default[:, spent]))
            found[name] = Comparison(ratio, float(np.median(gains)), *median_interval(gains))
    return found


def summary(comparisons: Mapping[str, Comparison]) -> str:
    """A line for each row, and against how many of them the default wins."""
    lines = [f"{name}: {comparison}" for name, comparison in comparisons.items()]
    won = [comparison for comparison in comparisons.values() if comparison.default_wins]
    behind = [name for name, comparison in comparisons.items() if not comparison.default_wins]
    last = f"faster than {len(won)} of {len(comparisons)}, at a final objective not shown to be lower"
    if won:
        ratios = [comparison.time for comparison in won]
        last += f", by {min(ratios):.2f} to {max(ratios):.2f} times"
    if behind:
        last += "; not so against " + "; ".join(behind)
    return "\n".join([*lines, f"{DEFAULT}: {last}"])


def main() -> None:
    """Measure, print, and write JSON where asked."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    photos.add_arguments(parser, count=100)
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    teapot = ObjectClass.load("teapot")
    table = measure(teapot, *photos.chosen(arguments, teapot))
    head = [column if column == unit else f"{column} ({unit})" for column, unit in COLUMNS.items()]
    print("| optimiser | " + " | ".join(head) + " |\n" + "|---" * (1 + len(head)) + "|")
    metrics = []
    for name, rows in table.items():
        found = [
            metric(
                f"{slug(name)}_{column}" if column == unit else f"{slug(name)}_{column}_{unit}",
                rows[:, place].tolist(),
                unit,
            )
            for place, (column, unit) in enumerate(COLUMNS.items())
        ]
        print(f"| {name} | " + " | ".join(f"{row['value']:.4g} +-{row['iqr']:.3g}" for row in found) + " |")
        metrics += found
    print(f"{len(rows)} photos; each on the same ones as {DEFAULT}:\n{summary(compare(table))}")
    if arguments.json:
        write(report(metrics, threads=1, packages=["scipy"]), arguments.json)


def slug(name: str) -> str:
    """A row's name in a metric's: without what stands in brackets."""
    return re.sub(r"\W+", "_", name.split(" (")[0])


if __name__ == "__main__":
    main()
