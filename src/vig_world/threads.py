"""Temporary limits on the cores that linear algebra uses."""

from collections.abc import Iterator
from contextlib import contextmanager

from vig.parallel.threads import linear_algebra, thread_limit


@contextmanager
def one_linear_algebra_thread() -> Iterator[None]:
    """Hold numpy's linear algebra of the whole process to one core.

    On two of a busy machine, threads of small products wait for each other ten times as long as they compute.
    """
    with linear_algebra().limit(limits=1, user_api="blas"):
        yield


@contextmanager
def one_thread() -> Iterator[None]:
    """Hold this thread, and numpy's linear algebra of the whole process, to one core.

    Small matrices take less time so, and sums do not depend on the number of cores.
    """
    with thread_limit(1), one_linear_algebra_thread():
        yield
