"""One core for numpy and torch, where matrices are small or sums must not depend on the number of cores."""

from __future__ import annotations

import functools
from collections.abc import Iterator
from contextlib import contextmanager

import torch
from threadpoolctl import ThreadpoolController


@contextmanager
def one_thread() -> Iterator[None]:
    """Inside, torch computes on one core for this thread, and numpy's linear algebra for the whole process.

    Small matrices take less time so, and sums do not depend on the number of cores.
    """
    thread_count = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        with _linear_algebra().limit(limits=1, user_api="blas"):
            yield
    finally:
        torch.set_num_threads(thread_count)


@functools.cache
def _linear_algebra() -> ThreadpoolController:
    """Finding the libraries takes long; those that are loaded after the first use are left alone."""
    return ThreadpoolController()
