"""Work shared out to threads: kernels and matrix products release Python's lock, so they run side by side."""

from __future__ import annotations

import functools
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import torch


def run_on_threads(work: Callable[[int], None], count: int) -> None:
    """Call work(0) ... work(count - 1), all at once; with one, on the calling thread."""
    if count == 1:
        work(0)
        return
    for _ in _pool(count).map(work, range(count)):
        pass


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
