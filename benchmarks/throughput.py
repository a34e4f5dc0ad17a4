"""Fits per second by threads and size of batch: descents from one start, and whole fits."""

import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from benchmarks.measuring import metric, timed
from vig.inference import ExplainSettings, Fit, Objective, explain, geometry_of, resolve
from vig.inference.posterior import pixel_prior
from vig.likelihood import Likelihood, Photos
from vig.parallel import set_thread_count, thread_count
from vig.recognition import Recognizer
from vig.scene import ObjectClass
from vig.search.optimizer import Budget

THREADS = (1, 2)
BATCHES = (1, 4, 16, 64, 256)
QUICK_BATCHES = (1, 4, 16)
MIN_RUNS = 3
LARGE_BATCH = 64
"""A batch of this size is a median in itself: one run of it is enough."""
ENOUGH_ITERATIONS = 200


def descent_budget(settings: ExplainSettings) -> Budget:
    """A descent from one start ends by the last stage's tolerance: iterations enough to converge."""
    return Budget(ENOUGH_ITERATIONS, settings.stages[-1].tolerance)


class Fits:
    """Photos (N, H, W, 3) linear RGB, their predictions, and the default settings."""

    def __init__(self, object_class: ObjectClass, photos: np.ndarray):
        self.object_class, self.photos, self.settings = (
            object_class,
            photos,
            resolve(ExplainSettings(), object_class),
        )
        self.recognizer = Recognizer.of_class(object_class)
        self.prediction = self.recognizer(photos)
        self.guesses = self.prediction.best()
        self.log_prior = np.stack(
            [
                pixel_prior(photo, mask, self.settings)[0]
                for photo, mask in zip(photos, self.prediction.mask, strict=True)
            ]
        )

    def together(self, which: np.ndarray) -> tuple[Objective, np.ndarray]:
        """One objective of photos `which` (B,), may repeat, and a start for each: points (B, P').

        Its prior is the class's alone: the recognition model's prediction is of one photo.
        """
        photos = Photos(self.photos[which], self.log_prior[which])
        camera = self.object_class.camera(self.photos.shape[1])
        geometry = geometry_of(self.object_class, self.settings.self_shadow)
        likelihood = Likelihood(geometry, camera, photos, self.settings.silhouette)
        objective = Objective(likelihood, self.object_class, prior_weight=self.settings.prior_weight)
        return objective, objective.point(self.guesses[which])

    def whole(self, which: np.ndarray) -> list[Fit]:
        """Explain photos `which` (B,), from the recognition model on."""
        return list(explain(self.photos[which], self.object_class, self.recognizer, self.settings))


@dataclass
class Rate:
    """Fits per second of each run and how many cores they kept busy (processor time over wall clock).

    kind: "one_start" or "whole".
    """

    kind: str
    threads: int
    batch: int
    per_second: list[float] = field(default_factory=list)
    cores: list[float] = field(default_factory=list)

    def metric(self) -> dict[str, Any]:
        """Its median and interquartile range."""
        name = f"fits_per_s_{self.kind}_threads{self.threads}_batch{self.batch}"
        return metric(name, self.per_second, "fits/s", "higher")


def members(run: int, batch: int, count: int) -> np.ndarray:
    """Which of `count` photos are in the `run`th batch: each goes on where the last one ended, cyclically."""
    return (np.arange(batch) + run * batch) % count


def runs(batch: int, count: int) -> int:
    """Batches to be timed: until every photo has been in one, and at least `MIN_RUNS` of small ones."""
    return max(MIN_RUNS if batch < LARGE_BATCH else 1, math.ceil(count / batch))


def throughput(fits: Fits, batches: Iterable[int]) -> list[Rate]:
    """Time all kinds of batches; their order rotates so that slow periods of the machine affect all."""
    before, rates = thread_count(), []
    try:
        for batch in batches:
            here = [Rate(kind, threads, batch) for kind in ("one_start", "whole") for threads in THREADS]
            for run in range(runs(batch, len(fits.photos))):
                which = members(run, batch, len(fits.photos))
                first = run % len(here)
                for rate in here[first:] + here[:first]:
                    _add(rate, fits, which)
            rates += here
    finally:
        set_thread_count(before)
    return rates


def _add(rate: Rate, fits: Fits, which: np.ndarray) -> None:
    set_thread_count(rate.threads)
    if rate.kind == "whole":
        _, time = timed(lambda: fits.whole(which))
    else:
        objective, starts = fits.together(which)
        photo, sigma = np.arange(len(which), dtype=np.int32), fits.settings.likelihood.sigma
        budget = descent_budget(fits.settings)
        _, time = timed(lambda: fits.settings.optimizer(objective, starts, photo, sigma, budget))
    rate.per_second.append(1000 * len(which) / time.wall_ms)
    rate.cores.append(time.processor_ms / time.wall_ms)


def table(rates: Iterable[Rate]) -> str:
    """A row of each number of threads and batch; cores busy behind the rate."""
    rows: dict[tuple[int, int], dict[str, str]] = {}
    for rate in rates:
        found, busy = rate.metric(), metric("", rate.cores, "")["value"]
        cell = f"{found['value']:.4g} +-{found['iqr']:.2g} | {busy:.2f}"
        rows.setdefault((rate.threads, rate.batch), {})[rate.kind] = cell
    lines = ["| threads | batch | one start (fits/s) | cores busy | whole fit (fits/s) | cores busy |"]
    lines.append("|---:|---:|---:|---:|---:|---:|")
    for (threads, batch), cells in sorted(rows.items()):
        lines.append(f"| {threads} | {batch} | {cells['one_start']} | {cells['whole']} |")
    return "\n".join(lines)
