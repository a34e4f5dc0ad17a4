"""Work shared out to threads: native code and matrix products release Python's lock, and run side by side.

Their number is one setting: `set_thread_count`, or OMP_NUM_THREADS in the environment, else the processors.
Once a program has loaded torch, torch's number and ours are the same: the number set here is passed to it,
and the one set there counts. Each thread computes on one core: a fit's matrices are small; on more cores a
product waits for threads far longer than it computes. While something is explained numpy's linear algebra is
therefore held to one thread, in the whole process.
"""

import functools
import os
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from typing import Any, TypeVar

from threadpoolctl import ThreadpoolController

from vig.io.checks import number_of
from vig.io.errors import UserError

Item = TypeVar("Item")
Result = TypeVar("Result")


_here = threading.local()
_starting = threading.Lock()
_chosen: int | None = None
_told = False  # whether the number chosen before torch was loaded has been passed to it


def thread_count() -> int:
    """Return the number of threads that work may use here: the one that is set, and 1 within such work."""
    own_count: int | None = getattr(_here, "count", None)
    return _set_count() if own_count is None else own_count


def set_thread_count(count: int) -> None:
    """Set how many threads work may use, for this process; UserError below 1."""
    global _chosen
    number = number_of(count)
    if number is None or not 1 <= number == int(number):
        raise UserError(f"expected one thread or more; got {count}. Give a whole number.")
    _chosen = int(number)
    if (library := _with_threads()) is not None:
        library.set_num_threads(_chosen)


def _set_count() -> int:
    if (library := _with_threads()) is not None:
        return int(library.get_num_threads())
    if _chosen is not None:
        return _chosen
    asked = os.environ.get("OMP_NUM_THREADS", "").split(",")[0].strip()
    if asked.isdecimal() and int(asked) > 0:
        return int(asked)
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _with_threads() -> Any:
    """Return torch, where the program has loaded it: its threads are one setting with ours."""
    global _told
    library: Any = sys.modules.get("torch")
    if not hasattr(library, "set_num_threads"):
        return None
    if not _told:
        _told = True
        if _chosen is not None:
            library.set_num_threads(_chosen)
    return library


@contextmanager
def thread_limit(count: int) -> Iterator[None]:
    """Limit the threads of everything that this thread calls; torch, too, where it is loaded."""
    library, before = _with_threads(), getattr(_here, "count", None)
    torch_before = library.get_num_threads() if library is not None else count
    _here.count = count
    try:
        if library is not None:
            library.set_num_threads(count)
        yield
    finally:
        _here.count = before
        if library is not None:
            library.set_num_threads(torch_before)


def on_one_core(work: Callable[[], Result]) -> Result:
    """Call work() with numpy's linear algebra on one core; work that is shared out still is."""
    with _linear_algebra:
        return work()


class _LinearAlgebra:
    """Limit of numpy's linear algebra to one thread, from the first that enters to the last that leaves."""

    def __init__(self) -> None:
        self.lock, self.inside = threading.Lock(), 0
        self.limit: Any = None

    def __enter__(self) -> None:
        with self.lock:
            self.inside += 1
            if self.inside == 1:
                self.limit = linear_algebra().limit(limits=1, user_api="blas")

    def __exit__(self, *raised: object) -> None:
        with self.lock:
            self.inside -= 1
            if self.inside == 0:
                self.limit.restore_original_limits()


_linear_algebra = _LinearAlgebra()


@functools.cache
def linear_algebra() -> ThreadpoolController:
    """Return the libraries of linear algebra; those that are loaded after the first use are left alone."""
    return ThreadpoolController()


def map_on_threads(work: Callable[[Item], Result], items: Sequence[Item]) -> Iterator[Result]:
    """Yield work(item) of each item in order, as many at once as `thread_count`.

    When its consumer stops early, items that were not begun are dropped.
    """
    threads = min(thread_count(), len(items))
    yield from map(work, items) if threads <= 1 else _pool(threads).map(work, items)


@functools.cache
def _pool(count: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(count, "vig", initializer=_become_worker)


def _become_worker() -> None:
    """Keep this thread to one core; torch's setting, which new threads take over, stays."""
    if (library := _with_threads()) is not None:
        with _starting:
            threads_before = library.get_num_threads()
            library.set_num_threads(1)
            restoring = threading.Thread(target=library.set_num_threads, args=(threads_before,))
            restoring.start()
            restoring.join()
    _here.count = 1


def _forget_threads() -> None:
    """Forget the threads of the parent, of which a forked child has none."""
    _pool.cache_clear()
    _linear_algebra.lock = threading.Lock()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forget_threads)
