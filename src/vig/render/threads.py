"""Work shared out to threads: kernels and matrix products release Python's lock, so they run side by side."""

from __future__ import annotations

import functools
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

import torch

Item, Result = TypeVar("Item"), TypeVar("Result")


def run_on_threads(work: Callable[[int], None], count: int) -> None:
    """Call work(0) ... work(count - 1), all at once; with one, on the calling thread."""
    if count == 1:
        work(0)
        return
    for _ in _pool(count).map(work, range(count)):
        pass


def map_on_threads(work: Callable[[Item], Result], items: Sequence[Item]) -> Iterator[Result]:
    """work(item) of each item in order, as many at once as torch has threads (`torch.set_num_threads`).

    Within, torch has one thread: what work itself shares out stays on its thread.
    """
    threads = min(torch.get_num_threads(), len(items))
    yield from map(work, items) if threads <= 1 else _pool(threads).map(work, items)


@functools.cache
def _pool(count: int) -> ThreadPoolExecutor:
    """Threads of which each uses one core: torch would give each all of them."""
    before = torch.get_num_threads()
    pool = ThreadPoolExecutor(count, "vig", initializer=torch.set_num_threads, initargs=(1,))
    barrier = [pool.submit(_wait) for _ in range(count)]
    for waiting in barrier:
        waiting.result()
    torch.set_num_threads(before)
    return pool


def _wait() -> None:
    """Long enough that each of a new pool's threads is started."""
    time.sleep(0.01)
