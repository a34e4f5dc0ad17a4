"""Work shared out to threads: kernels and matrix products release Python's lock, so they run side by side.

How many is one setting, torch's own: `torch.set_num_threads`, or OMP_NUM_THREADS in the environment.
"""

from __future__ import annotations

import functools
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from typing import TypeVar

import torch

Item, Result = TypeVar("Item"), TypeVar("Result")

_here = threading.local()


def thread_count() -> int:
    """How many threads work may be shared out to here: as torch says, and one within such work."""
    kept: int | None = getattr(_here, "count", None)
    return torch.get_num_threads() if kept is None else kept


@contextmanager
def small_matrices() -> Iterator[None]:
    """Within, torch computes on one thread: for matrices of a fit's size more cost time, twenty times as
    much when cores are busy. `thread_count` stays what it was, for work that is worth sharing out.
    """
    kept, before = getattr(_here, "count", None), torch.get_num_threads()
    _here.count = thread_count()
    if before != 1:
        torch.set_num_threads(1)
    try:
        yield
    finally:
        _here.count = kept
        if before != 1:
            torch.set_num_threads(before)


def run_on_threads(work: Callable[[int], None], count: int) -> None:
    """Call work(0) ... work(count - 1), all at once; with one, on the calling thread."""
    if count == 1:
        work(0)
        return
    with small_matrices():
        for _ in _pool(count).map(work, range(count)):
            pass


def map_on_threads(work: Callable[[Item], Result], items: Sequence[Item]) -> Iterator[Result]:
    """work(item) of each item in order, as many at once as `thread_count`."""
    threads = min(thread_count(), len(items))
    if threads <= 1:
        yield from map(work, items)
        return
    with small_matrices():
        yield from _pool(threads).map(work, items)


@functools.cache
def _pool(count: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(count, "vig", initializer=_become_worker)


def _become_worker() -> None:
    _here.count = 1
