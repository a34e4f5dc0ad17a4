"""What to do at the silhouette: three objectives, the same photos, starts, pixel model, priors, optimisers.

`python -m benchmarks.silhouettes --dataset D --count N --seed S [--among FIRST END] [--json FILE]` draws N images
of a training split that training holds out for validation, and descends from the recognition model's best
guess: "exact" blends log-likelihoods by coverage, "paper" holds the mask constant, "colours" blends colours
(`benchmarks.blending`). First it prints the derivative at one edge. As many processes as OMP_NUM_THREADS says.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch

from benchmarks.blending import ColourBlending, Valued, edge
from benchmarks.masks import HELD_OUT, compared
from vig.dataset import read_dataset
from vig.evaluation import angle_error_deg, segmentation_iou, shape_error_mm
from vig.inference import (
    LBFGS,
    Annealed,
    Budget,
    ConjugateGradient,
    ExplainSettings,
    LevenbergMarquardt,
    Objective,
    Optimizer,
    objective_of,
)
from vig.inference.judging import MASK_SIGMA
from vig.likelihood import ROBUST
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

HALF_HIDDEN = 0.4
LOST = 10.0
"""Nats below the best end of a photo that any run reached, from which an end counts as stuck."""


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
    """Every run on one photo (H, W, 3): (1 + runs, columns), the start first. visible (H, W): the true mask."""
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
    photos = torch.from_numpy(
        linear_from_srgb(dataset.read("rgb", chosen).astype(np.float32) / 255)
    ).float()
    visible, truth = (
        dataset.read("mask_visib", chosen),
        Latents.from_vector(torch.from_numpy(dataset.latents[chosen])),
    )
    prediction = Recognizer.of_class(teapot)(photos)
    settings = ExplainSettings() if photo_prior else ExplainSettings(mask_weight=0.0, surroundings=0.0)
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
    line["near_best"] = float((short <= LOST).mean())
    line["evaluations"] = float(np.median(column["evaluations"]))
    failed = column["vain"] >= VAIN
    line["failed"] = float(failed.mean())
    line["small_gain"] = float(((column["converged"] > 0) & ~failed).mean())
    line["ms"] = float(np.median(column["ms"]))
    return line


def show_edge() -> dict[str, Any]:
    """Print what `edge` says at contrast 0.5, and where it has its maximum."""
    places = torch.linspace(0.0, 1.0, 11)
    print("One edge, contrast 0.5, half covered by the guess, derivative per pixel outwards in nats:")
    half = torch.tensor([0.5])
    report: dict[str, Any] = {}
    for name, true_place in (("the pixel shows the object", 1.0), ("the pixel shows the background", 0.0)):
        found = edge(half, true_place, 0.5, ROBUST)
        report[name] = {
            "posterior": float(found.posterior),
            "colours": float(found.colours),
            "likelihoods": float(found.likelihoods),
        }
        print(
            f"  {name}: posterior {float(found.posterior):.1e}, colours {float(found.colours):+.1e},"
            f" log-likelihoods {float(found.likelihoods):+.2f}"
        )
    print("The same with the guess covering", " ".join(f"{place:5.1f}" for place in places.tolist()))
    for name, true_place in (("object", 1.0), ("background", 0.0)):
        found = edge(places, true_place, 0.5, ROBUST)
        report[f"colours along {name}"] = found.colours.tolist()
        print(f"  {name}: colours", " ".join(f"{slope:+.2g}" for slope in found.colours.tolist()))
    fine = torch.linspace(0.0, 1.0, 1001)
    for contrast in (0.1, 0.2, 0.5):
        errors, reach = [], []
        for true_place in np.linspace(0.005, 0.995, 100).tolist():
            found = edge(fine, true_place, contrast, ROBUST)
            errors.append(
                [float(fine[v.argmax()]) - true_place for v in (found.colours_value, found.likelihoods_value)]
            )
        for true_place, sign in ((1.0, 1), (0.0, -1)):
            found = edge(fine, true_place, contrast, ROBUST)
            reach.append(
                [float((sign * slope > 0.1).double().mean()) for slope in (found.colours, found.likelihoods)]
            )
        bias, scatter = np.mean(errors, 0), np.abs(errors).mean(0)
        report[f"contrast {contrast}"] = {
            "bias": bias.tolist(),
            "error": scatter.tolist(),
            "reach": np.mean(reach, 0).tolist(),
        }
        print(
            f"contrast {contrast}: of a pixel that is all object or all background, the share in which the edge is"
            f" pulled the right way by 0.1 nats or more: colours {np.mean(reach, 0)[0]:.0%},"
            f" log-likelihoods {np.mean(reach, 0)[1]:.0%}; in the true edge's own pixel the maximum is off by"
            f" {scatter[0]:.2f} and {scatter[1]:.2f} pixels, on the mean {bias[0]:+.2f} and {bias[1]:+.2f}"
        )
    return report


def main() -> None:
    """Measure, print, and write JSON where asked."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--dataset", type=Path, required=True)
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--among", type=int, nargs=2, metavar=("FIRST", "END"), help="samples to draw from")
    parser.add_argument("--photo-prior", action="store_true", help="the pixel prior of a fit, not the paper's")
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    report: dict[str, Any] = {"edge": show_edge()}
    dataset = read_dataset(arguments.dataset, "train")
    first, end = arguments.among or (max(len(dataset) - HELD_OUT, 0), len(dataset))
    count = min(arguments.count, end - first)
    rng = np.random.default_rng(arguments.seed)
    chosen = np.sort(rng.choice(np.arange(first, end), count, replace=False))
    workers = torch.get_num_threads()
    parts = np.array_split(chosen, min(count, 4 * workers))
    with ProcessPoolExecutor(workers, multiprocessing.get_context("spawn")) as pool:
        table = np.concatenate(
            list(
                pool.map(
                    run,
                    [arguments.dataset] * len(parts),
                    parts,
                    [arguments.photo_prior] * len(parts),
                )
            )
        )
    best, occlusion = table[:, :, 0].max(1), dataset.occlusion[chosen]
    groups = {
        "all": np.ones(count, bool),
        f"at most {HALF_HIDDEN:.0%} hidden": occlusion <= HALF_HIDDEN,
        f"more than {HALF_HIDDEN:.0%} hidden": occlusion > HALF_HIDDEN,
    }
    names = [" | ".join(name) for name in (START, *RUNS)]
    for group, within in groups.items():
        if not within.any():
            continue
        lines = {name: summary(table[within, i], best[within]) for i, name in enumerate(names)}
        report[group] = {"count": int(within.sum()), "runs": lines}
        print(f"\n{group}, {within.sum()} images")
        print("| objective | optimiser | " + " | ".join(lines[names[0]]) + " |")
        for name, line in lines.items():
            print(f"| {name} | " + " | ".join(f"{value:.4g}" for value in line.values()) + " |")
        print("\nexact against the other, same optimiser: mean gain, 95 % interval, better on, worse on")
        for (name, how), i in zip(RUNS, range(1, len(names)), strict=True):
            if name == "exact":
                continue
            j = 1 + RUNS.index(("exact", how))
            for column, sign in (("value", 1), ("azimuth", -1), ("shape", -1), ("iou", 1)):
                at = COLUMNS.index(column)
                gain = compared(sign * table[within, j, at], sign * table[within, i, at], rng)
                report[group][f"exact over {name} | {how}: {column}"] = gain
                low, high = gain["mean_gain_ci95"]
                print(
                    f"  {name} | {how}: {column} {gain['mean_gain']:+.4g} [{low:+.4g}, {high:+.4g}],"
                    f" {gain['share_better']:.0%}, {gain['share_worse']:.0%}"
                )
    if arguments.json:
        report.update(count=count, seed=arguments.seed, rows=table.tolist(), names=names, columns=COLUMNS)
        arguments.json.write_text(json.dumps(report, indent=1) + "\n")


if __name__ == "__main__":
    main()
