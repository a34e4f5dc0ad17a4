"""How time and memory grow: `python -m benchmarks.growth [--json FILE] [--fits N]`.

One full evaluation (objective, gradient, normal matrix) on one thread against pixels, faces, shape components
and points in a batch, and the time to make a mesh ready, each beside the exponent of its growth between the
two largest sizes: 1 is proportional. Then N fits of different photos in one process: how much its peak
memory grew after the first tenth; and the rate of two processes over that of one.
"""

from __future__ import annotations

import argparse
import math
import resource
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch

from benchmarks import inputs
from benchmarks.case import STANDARD_SIZE, Case, Ours, make_case
from benchmarks.measuring import interleaved, metric, report, write
from vig import Explainer
from vig.likelihood.kernels.geometry import Geometry
from vig.scene import Latents, ObjectClass, ShapeModel

SIZES = (60, 120, 240, 480, 1020)
"""Multiples of the backdrop's cells; see `case.BACKDROP_CELLS`."""
SUBDIVISIONS = (0, 1, 2)
COMPONENTS = (1, 4, 10)
BATCHES = (1, 4, 16, 64)
FITS = 200
DIFFERENT_PHOTOS = 50
BOX = (25, 25, 100, 100)
"""Where the object of a photo of the generator is, more or less."""


def thinned(case: Case, components: int) -> Case:
    """The case with its first components alone."""
    model = case.model
    few = replace(
        model,
        basis=model.basis[:components],
        explained_variance_ratio=model.explained_variance_ratio[:components],
    )
    guesses = tuple(replace(each, shape=each.shape[:, :components]) for each in case.guesses)
    return replace(case, model=few, truth=replace(case.truth, shape=case.truth.shape[:, :components]),
                   guesses=guesses)  # fmt: skip


def batched(case: Case, count: int) -> Callable[[int], object]:
    """An evaluation of `count` points in one call."""
    mine = Ours(case)
    some = [case.guesses[index % len(case.guesses)].to_vector() for index in range(count)]
    latents, photo = Latents.from_vector(torch.cat(some)), torch.zeros(count, dtype=torch.int32)
    framing, sigma = torch.zeros(count, 4), torch.full((count,), 0.1)
    return lambda _: mine.likelihood(latents, framing, photo, sigma, images=False)


def measured(what: str, calls: Mapping[int, Callable[[int], object]], rounds: int) -> list[dict[str, Any]]:
    """Milliseconds by size, printed, and the exponent between the two largest sizes."""
    times = interleaved({str(size): call for size, call in calls.items()}, rounds)
    rows = [metric(f"{what}_{size}_ms", values, "ms") for size, values in times.items()]
    last, largest = list(calls)[-2:]
    slopes = np.log(times[str(largest)] / times[str(last)]) / math.log(largest / last)
    rows.append(metric(f"{what}_exponent", slopes, ""))
    for row in rows:
        print(f"{row['name']}: {row['value']} {row['unit']} (interquartile range {row['iqr']})", flush=True)
    return rows


def ready(model: ShapeModel) -> Callable[[int], object]:
    """Make a mesh ready for the renderer."""
    return lambda _: Geometry(model)


def memory_growth(count: int) -> list[dict[str, Any]]:
    """Peak megabytes of this process that `count` fits add after their first tenth, and fits per second."""
    images, _ = inputs.made(ObjectClass.load("teapot"), DIFFERENT_PHOTOS, seed=0)
    explainer, started, early = Explainer(), time.perf_counter(), 0.0
    for index in range(count):
        explainer.explain(images[index % len(images)], box=BOX)
        if index == count // 10:
            early = _peak()
    rate = count / (time.perf_counter() - started)
    rows = [metric(f"memory_added_by_{count}_fits_mb", [_peak() - early], "MB"),
            metric("fits_per_s", [rate], "fits/s", "higher")]  # fmt: skip
    for row in rows:
        print(f"{row['name']}: {row['value']} {row['unit']}")
    return rows


def two_workers(rounds: int) -> list[dict[str, Any]]:
    """Photos per second with two worker processes over those with one, workers' start not included."""
    images, _ = inputs.made(ObjectClass.load("teapot"), DIFFERENT_PHOTOS, seed=0)
    explainer, many = Explainer(), list(images) * 2
    rates: dict[int, list[float]] = {1: [], 2: []}
    for _ in range(rounds):
        for workers, found in rates.items():
            ends = []
            for _ in explainer.explain_many(many, [BOX] * len(many), workers):
                ends.append(time.perf_counter())
            # The first photos wait for the workers to start.
            warm = len(ends) // 5
            found.append((len(ends) - 1 - warm) / (ends[-1] - ends[warm]))
    row = metric("rate_of_2_workers_over_1", np.divide(rates[2], rates[1]), "x", "higher")
    print(f"{row['name']}: {row['value']} (interquartile range {row['iqr']})")
    return [row]


def _peak() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1000  # kilobytes on Linux


def measure(rounds: int) -> list[dict[str, Any]]:
    """All growths of time."""
    torch.set_num_threads(1)
    sizes = {size * size: Ours(make_case(size)).full for size in SIZES}
    meshes = [make_case(STANDARD_SIZE, subdivisions) for subdivisions in SUBDIVISIONS]
    few = {count: Ours(thinned(meshes[0], count)).full for count in COMPONENTS}
    found = measured("pixels", sizes, rounds)
    found += measured("faces", {len(case.model.faces): Ours(case).full for case in meshes}, rounds)
    found += measured("mesh_ready", {len(case.model.faces): ready(case.model) for case in meshes}, rounds)
    found += measured("components", few, rounds)
    return found + measured("batch", {count: batched(meshes[0], count) for count in BATCHES}, rounds)


def main() -> None:
    """Measure, print, and write JSON where asked."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--repeats", type=int, default=9)
    parser.add_argument("--fits", type=int, default=FITS)
    arguments = parser.parse_args()
    if arguments.repeats < 1 or arguments.fits < 10:
        parser.error("expected one repeat or more, and ten fits or more")
    metrics = measure(arguments.repeats) + memory_growth(arguments.fits) + two_workers(rounds=3)
    if arguments.json:
        write(report(metrics, threads=1), arguments.json)


if __name__ == "__main__":
    main()
