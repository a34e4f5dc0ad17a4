"""What to do at the silhouette: three objectives, the same photos, starts, pixel model, priors, optimisers.

`python -m benchmarks.silhouettes --dataset D --count N --seed S [--among FIRST END] [--json FILE]` draws N
images of those of a training split that training holds out for validation, and descends from the recognition
model's best guess: "exact" blends log-likelihoods by coverage, "paper" holds the mask constant, "colours"
blends colours (`benchmarks.blending`). Ends are compared by the exact objective. First it prints what one
edge gives (`benchmarks.edge`). It takes as many processes as torch has threads (OMP_NUM_THREADS).
"""

from __future__ import annotations

import argparse
import functools
import json
import multiprocessing
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch

from benchmarks.blending import ColourBlending, Valued
from benchmarks.edge import show
from benchmarks.masks import HELD_OUT, compared
from vig.dataset import read_dataset
from vig.dataset.metrics import angle_error_deg, segmentation_iou, shape_error_mm
from vig.inference import ExplainSettings, Objective, objective_of
from vig.inference.judging import MASK_SIGMA
from vig.likelihood import ROBUST
from vig.optimizers.annealing import Annealed
from vig.optimizers.conjugate_gradient import ConjugateGradient
from vig.optimizers.lbfgs import LBFGS
from vig.optimizers.levenberg_marquardt import LevenbergMarquardt
from vig.optimizers.optimizer import Budget, Optimizer
from vig.recognition import Prediction, Recognizer
from vig.scene import Latents, ObjectClass, linear_from_srgb

OPTIMIZERS: dict[str, tuple[Optimizer, Budget]] = {
    "L-BFGS": (LBFGS(), Budget(60)),
    "cg, unscaled": (ConjugateGradient(scaled=False), Budget(50)),
    "LM": (LevenbergMarquardt(), Budget(50)),
    "LM, annealed": (Annealed(LevenbergMarquardt()), Budget(75)),
}
COLOURS: dict[str, dict[str, Any]] = {
    "colours": {},
    "colours, constant beyond": {"beyond": "constant"},
    "colours, centre decides": {"covered": "centre"},
}
RUNS = [
    *((silhouette, optimizer) for optimizer in OPTIMIZERS for silhouette in ("exact", "paper")),
    *((colours, "L-BFGS") for colours in COLOURS),
]
START = ("start", "")
COLUMNS = ("value", "azimuth", "elevation", "shape", "iou", "evaluations", "vain", "converged", "ms")
VAIN = 15
"""Evaluations after the best one by which a line search that failed is known: L-BFGS allows 20 in one."""

HEAD = (
    "short of best (nats)",
    "azimuth (degrees)",
    "within 1, 5 degrees",
    "elevation (degrees)",
    "shape (mm)",
    "mask IoU",
    "evaluations",
    "small gain, failed line",
)
JUDGED = {"value": 1, "azimuth": -1, "elevation": -1, "shape": -1, "iou": 1}
"""By what one end is better than another, and whether more of it is."""

HALF_HIDDEN = 0.4


class Watched:
    """A problem that counts how many of its evaluations since the best one, under this noise, were in vain.

    scale: an objective whose normal matrix at the start stands for the problem's own, so that first-order
    searches of all problems count their parameters in the same units.
    """

    def __init__(self, problem: Objective | ColourBlending, scale: Objective | None):
        self.problem, self.scale = problem, scale
        self.lower, self.upper, self.dtype, self.device = (
            problem.lower,
            problem.upper,
            problem.dtype,
            problem.device,
        )
        self.units: torch.Tensor | None = None
        self.best, self.vain, self.noise = -np.inf, 0, 0.0

    def __call__(
        self, points: torch.Tensor, photo: torch.Tensor, sigma: torch.Tensor, derivatives: bool = True
    ) -> Valued:
        """The problem's valuation of one point."""
        valued = self.problem(points, photo, sigma, derivatives)
        if float(sigma) != self.noise:
            self.best, self.vain, self.noise = -np.inf, 0, float(sigma)
            if self.scale is not None:
                self.units = self.scale(points, photo, sigma).normal
        self.vain = 0 if float(valued.value) > self.best else self.vain + 1
        self.best = max(self.best, float(valued.value))
        normal = valued.normal if self.scale is None else self.units
        return Valued(valued.value, valued.gradient, normal)


def descents(
    photo: torch.Tensor,
    prediction: Prediction,
    object_class: ObjectClass,
    truth: Latents,
    visible: np.ndarray,
    settings: ExplainSettings,
) -> np.ndarray:
    """Every run on one photo (H, W, 3): (1 + runs, columns), the start first.

    truth, visible (H, W): what errors are measured against.
    """
    exact = objective_of(photo, prediction, object_class, settings)
    paper = objective_of(photo, prediction, object_class, replace(settings, silhouette="paper"))
    start = exact.point(prediction.best())
    problems: dict[str, Objective | ColourBlending] = {"exact": exact, "paper": paper}
    for name, how in COLOURS.items():
        problems[name] = ColourBlending(exact, object_class, start, **how)
    zero, sigma, model = torch.zeros(1, dtype=torch.int32), ROBUST.sigma, object_class.shape_model
    exact(start, zero, torch.tensor([sigma]))  # kernels are made here, not in a run's time
    rows = []
    for name, how in [START, *RUNS]:
        began = time.perf_counter()
        points, evaluations, vain, converged = start, 1, 0, False
        if name != START[0]:
            optimizer, budget = OPTIMIZERS[how]
            own = how.startswith("LM") or name == "exact"
            watched = Watched(problems[name], None if own else exact)
            end = optimizer(watched, start, zero, sigma, budget)
            points, evaluations, vain = end.points, int(end.evaluations), watched.vain
            converged = bool(end.converged)
        spent = 1000 * (time.perf_counter() - began)
        found = exact.latents(points)
        shown = exact(points, zero, torch.tensor([MASK_SIGMA]), derivatives=False).evaluation
        assert shown.coverage is not None and shown.posterior is not None
        mask = ((shown.coverage >= 0.5) & (shown.posterior > 0.5)).numpy()
        rows.append(
            (
                float(exact(points, zero, torch.tensor([sigma])).value),
                *angle_error_deg(found.azimuth, truth.azimuth),
                *angle_error_deg(found.elevation, truth.elevation),
                *shape_error_mm(model.vertices(found.shape), model.vertices(truth.shape)),
                *segmentation_iou(mask, visible[None]),
                evaluations,
                vain,
                converged,
                spent,
            )
        )
    return np.array(rows, np.float64)


def run(folder: Path, chosen: np.ndarray, photo_prior: bool) -> np.ndarray:
    """`descents` on the samples `chosen`: (N, 1 + runs, columns)."""
    torch.set_num_threads(1)
    teapot, dataset = ObjectClass.load("teapot"), read_dataset(folder, "train")
    photos = torch.from_numpy(linear_from_srgb(dataset.read("rgb", chosen).astype(np.float32) / 255)).float()
    visible, truth = (
        dataset.read("mask_visib", chosen),
        Latents.from_vector(torch.from_numpy(dataset.latents[chosen])),
    )
    prediction = Recognizer.of_class(teapot)(photos)
    weight = 1.0 if photo_prior else 0.0
    settings = ExplainSettings(ROBUST, mask_weight=weight, surroundings=weight)
    return np.stack(
        [
            descents(photos[i], prediction[i : i + 1], teapot, truth[i : i + 1], visible[i], settings)
            for i in range(len(chosen))
        ]
    )


def summary(rows: np.ndarray, best: np.ndarray) -> dict[str, float]:
    """One line of the table from one run's rows (N, columns); best (N,): the photos' highest values."""
    column = dict(zip(COLUMNS, rows.T, strict=True))
    short = best - column["value"]
    line = {"short_median": float(np.median(short)), "short_mean": float(short.mean())}
    for name in ("azimuth", "elevation", "shape", "iou"):
        line[f"{name}_median"] = float(np.median(column[name]))
        line[f"{name}_mean"] = float(column[name].mean())
    line["within_1"] = float((column["azimuth"] <= 1).mean())
    line["within_5"] = float((column["azimuth"] <= 5).mean())
    line["evaluations"] = float(np.median(column["evaluations"]))
    failed = column["vain"] >= VAIN
    line["failed"] = float(failed.mean())
    line["small_gain"] = float(((column["converged"] > 0) & ~failed).mean())
    line["ms"] = float(np.median(column["ms"]))
    return line


def tables(table: np.ndarray, occlusion: np.ndarray, rng: np.random.Generator) -> dict[str, Any]:
    """Print and return the tables of `descents` (N, 1 + runs, columns), all and by occlusion (N,)."""
    best, report = table[:, :, 0].max(1), {}
    groups = {
        "all": np.ones(len(table), bool),
        f"at most {HALF_HIDDEN:.0%} hidden": occlusion <= HALF_HIDDEN,
        f"more than {HALF_HIDDEN:.0%} hidden": occlusion > HALF_HIDDEN,
    }
    for group, within in groups.items():
        if not within.any():
            continue
        lines = [summary(table[within, i], best[within]) for i in range(table.shape[1])]
        compare = against_exact(table[within], rng)
        names = [" | ".join(name) for name in (START, *RUNS)]
        report[group] = {"runs": dict(zip(names, lines, strict=True)), "exact over": compare}
        print(f"\n{group}: {within.sum()} images\n")
        print("| objective | optimiser | " + " | ".join(HEAD) + " |\n" + "|---" * (2 + len(HEAD)) + "|")
        for name, line in zip(names, lines, strict=True):
            print(f"| {name} | {shown(line)} |")
        print("\n| exact over | by | " + " | ".join(JUDGED) + " |\n" + "|---" * (2 + len(JUDGED)) + "|")
        for name, gains in compare.items():
            cells = [
                f"{g['mean_gain']:+.3g} [{g['mean_gain_ci95'][0]:+.3g}, {g['mean_gain_ci95'][1]:+.3g}],"
                f" {g['share_better']:.0%} : {g['share_worse']:.0%}"
                for g in gains.values()
            ]
            print(f"| {name} | " + " | ".join(cells) + " |")
    return report


def shown(line: dict[str, float]) -> str:
    """The cells of a line of the table."""
    cells = [f"{line['short_median']:,.0f}"]
    for name, digits in (("azimuth", 1), ("elevation", 1), ("shape", 1), ("iou", 3)):
        cells.append(f"{line[f'{name}_median']:.{digits}f} / {line[f'{name}_mean']:.{digits}f}")
        if name == "azimuth":
            cells.append(f"{line['within_1']:.0%}, {line['within_5']:.0%}")
    cells.append(f"{line['evaluations']:.0f}")
    cells.append(f"{line['small_gain']:.0%}, {line['failed']:.0%}")
    return " | ".join(cells)


def against_exact(table: np.ndarray, rng: np.random.Generator) -> dict[str, dict[str, Any]]:
    """How much better "exact" ends than each other objective under the same optimiser, image by image."""
    found = {}
    for number, (name, how) in enumerate(RUNS):
        if name == "exact":
            continue
        ours, theirs = table[:, 1 + RUNS.index(("exact", how))], table[:, 1 + number]
        found[f"{name} | {how}"] = {
            column: compared(sign * ours[:, i], sign * theirs[:, i], rng)
            for column, sign in JUDGED.items()
            for i in [COLUMNS.index(column)]
        }
    return found


def main() -> None:
    """Measure, print, and write JSON where asked."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--dataset", type=Path, required=True)
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--among", type=int, nargs=2, metavar=("FIRST", "END"), help="samples to draw from")
    parser.add_argument("--photo-prior", action="store_true", help="pixel priors as in a fit")
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    report: dict[str, Any] = {"edge": show(ROBUST)}
    dataset = read_dataset(arguments.dataset, "train")
    first, end = arguments.among or (max(len(dataset) - HELD_OUT, 0), len(dataset))
    count = min(arguments.count, end - first)
    rng = np.random.default_rng(arguments.seed)
    chosen = np.sort(rng.choice(np.arange(first, end), count, replace=False))
    workers = torch.get_num_threads()
    parts = np.array_split(chosen, min(count, 4 * workers))
    with ProcessPoolExecutor(workers, multiprocessing.get_context("spawn")) as pool:
        work = functools.partial(run, arguments.dataset, photo_prior=arguments.photo_prior)
        table = np.concatenate(list(pool.map(work, parts)))
    report |= tables(table, dataset.occlusion[chosen], rng)
    if arguments.json:
        report |= {"chosen": chosen.tolist(), "columns": COLUMNS, "rows": table.tolist()}
        arguments.json.write_text(json.dumps(report, indent=1) + "\n")


if __name__ == "__main__":
    main()
