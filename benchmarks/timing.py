"""Timing functions, several of them side by side, on a machine whose speed changes."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

Result = TypeVar("Result")

LEAST_SECONDS = 0.1
WARM_UP = 3
"""Calls before any is timed; Mitsuba compiles a second set of kernels at the second one."""


@dataclass(frozen=True)
class Time:
    """How long a call took by the wall clock, and by this process's processor time, all threads together."""

    wall_ms: float
    processor_ms: float


def timed(call: Callable[[], Result]) -> tuple[Result, Time]:
    """What a call returns, and its time."""
    processor, wall = time.process_time(), time.perf_counter()
    result = call()
    wall = time.perf_counter() - wall
    return result, Time(1000 * wall, 1000 * (time.process_time() - processor))


def interleaved(calls: Mapping[str, Callable[[int], object]], rounds: int) -> dict[str, np.ndarray]:
    """Milliseconds per call of each function, one number per round.

    In every round each function runs once more than `LEAST_SECONDS` long, called with 0, 1, 2, ..., and the
    order of the functions turns by one from round to round, so that a slow spell of the machine hits all of
    them. Each is called before the first round, which compiles what is to be compiled.
    """
    repeats = {name: _calls_within(call, LEAST_SECONDS) for name, call in calls.items()}
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
    """How many calls of a function fill a time, warm."""
    for index in range(WARM_UP):
        call(index)
    started = time.perf_counter()
    call(0)
    return max(1, round(seconds / (time.perf_counter() - started)))
