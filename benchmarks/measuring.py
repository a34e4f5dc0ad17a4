"""What the benchmarks share: timing, metrics with a direction and intervals, and the JSON file."""

import json
import os
import platform
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Any, Literal, TypeVar

import numpy as np

from vig.io.files import atomic_write
from vig.io.machine import processor

Result = TypeVar("Result")
Better = Literal["higher", "lower"]

MIN_SECONDS = 0.1
WARM_UP = 3
"""Calls before any is timed; Mitsuba compiles a second set of kernels at the second one."""


def metric(name: str, values: Iterable[float], unit: str, better: Better = "lower") -> dict[str, Any]:
    """Median and interquartile range of repeated measurements, to four significant digits."""
    low, middle, high = np.percentile(np.asarray(list(values), np.float64), [25, 50, 75])
    return {
        "name": name,
        "value": float(f"{middle:.4g}"),
        "unit": unit,
        "better": better,
        "iqr": float(f"{high - low:.4g}"),
    }


def report(metrics: list[dict[str, Any]], threads: int, packages: Iterable[str] = ()) -> dict[str, Any]:
    """`{"machine", "versions", "metrics"}`, ready for JSON; `packages` are listed beside our own."""
    names = ["vig", "torch", "numpy", *packages]
    versions = {name: metadata.version(name) for name in names}
    return {
        "machine": {"processor": processor(), "cpus": os.cpu_count(), "threads": threads},
        "versions": {"python": platform.python_version(), **versions},
        "metrics": metrics,
    }


def write(found: dict[str, Any], path: Path) -> None:
    """Write a report as JSON, whole or not at all. UserError when it cannot be written there."""
    with atomic_write(path) as temporary:
        temporary.write_text(json.dumps(found, indent=2) + "\n")


@dataclass(frozen=True)
class Time:
    """How long a call took by the wall clock, and by this process's processor time, all threads together."""

    wall_ms: float
    processor_ms: float


def timed(call: Callable[[], Result]) -> tuple[Result, Time]:
    """The result of a call, and its time."""
    processor, wall = time.process_time(), time.perf_counter()
    result = call()
    wall = time.perf_counter() - wall
    return result, Time(1000 * wall, 1000 * (time.process_time() - processor))


def interleaved(calls: Mapping[str, Callable[[int], object]], rounds: int) -> dict[str, np.ndarray]:
    """Milliseconds per call of each function, one number per round.

    In every round each function runs once more than `MIN_SECONDS` long, called with 0, 1, 2, ..., and the
    order of the functions rotates by one from round to round, so that a slow period of the machine affects
    all. Each is called before the first round, so that nothing is compiled later.
    """
    repeats = {name: _calls_within(call, MIN_SECONDS) for name, call in calls.items()}
    found: dict[str, list[float]] = {name: [] for name in calls}
    names = list(calls)
    for turn in range(rounds):
        first = turn % len(names)
        for name in names[first:] + names[:first]:
            started = time.perf_counter()
            for index in range(repeats[name]):
                calls[name](index)
            found[name].append(1000 * (time.perf_counter() - started) / repeats[name])
    return {name: np.array(values) for name, values in found.items()}


def _calls_within(call: Callable[[int], object], seconds: float) -> int:
    """Number of calls of a function, warm, that take this time."""
    for index in range(WARM_UP):
        call(index)
    started = time.perf_counter()
    call(0)
    return max(1, round(seconds / (time.perf_counter() - started)))
