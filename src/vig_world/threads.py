"""On how many cores numpy and torch compute, for a while."""

from __future__ import annotations

import functools
from collections.abc import Iterator
from contextlib import contextmanager

import torch
from threadpoolctl import ThreadpoolController


@contextmanager
def torch_threads(count: int) -> Iterator[None]:
    """Inside, torch computes on so many cores for this thread."""
    before = torch.get_num_threads()
    torch.set_num_threads(count)
    try:
        yield
    finally:
        torch.set_num_threads(before)


@contextmanager
def one_linear_algebra_thread() -> Iterator[None]:
    """Inside, numpy's linear algebra computes on one core for the whole process.

    On two of a busy machine, threads of small products wait for each other ten times as long as they compute.
    """
    with _linear_algebra().limit(limits=1, user_api="blas"):
        yield


@contextmanager
def one_thread() -> Iterator[None]:
    """Inside, torch computes on one core for this thread, and numpy's linear algebra for the whole process.

    Small matrices take less time so, and sums do not depend on the number of cores.
    """
    with torch_threads(1), one_linear_algebra_thread():
        yield


@functools.cache
def _linear_algebra() -> ThreadpoolController:
    """Finding the libraries takes long; those that are loaded after the first use are left alone."""
    return ThreadpoolController()
