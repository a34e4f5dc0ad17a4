"""Work shared out to processes of this machine: where Python's lock would keep threads waiting."""

from __future__ import annotations

import functools
import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from itertools import islice
from typing import Any, TypeVar

from vig.errors import UserError

Given = TypeVar("Given")
Result = TypeVar("Result")

AHEAD = 4
"""Items handed out at once for each process: enough that none waits, and few copies of what they hold."""

_work: Callable[[Any], Any] | None = None


def map_in_processes(
    prepare: Callable[[Any], Callable[[Given], Result]], shared: Any, items: Iterable[Given], processes: int
) -> Iterator[Result]:
    """work(item) of each item in order, work being `prepare(shared)`, which each process calls once.

    Each process has one thread for linear algebra, ignores SIGINT, and ends when this process dies. When the
    consumer stops early, at most `AHEAD` items for each are finished, the others dropped.

    Args:
        prepare: A function of a module, no closure: processes are spawned and import it.
        shared: What it gets.
        items: They and their results hold arrays, not tensors, which torch would send through shared memory.
        processes: How many.

    Raises:
        UserError: A process was killed.
        Exception: What `prepare` or work raised.
    """
    context = multiprocessing.get_context("spawn")
    left = iter(items)
    pool = ProcessPoolExecutor(processes, context, initializer=_begin, initargs=(prepare, shared))
    waiting: list[Future[Result]] = []

    def hand_out(count: int) -> None:
        with one_thread_in_children(), without_interrupts():
            waiting.extend(pool.submit(_do, item) for item in islice(left, count))

    try:
        hand_out(processes * AHEAD)
        while waiting:
            result = waiting.pop(0).result()
            hand_out(1)
            yield result
    except BrokenProcessPool as error:
        raise UserError(
            f"one of {processes} worker processes was killed, possibly out of memory; what is done stays."
            " Run it again with fewer workers."
        ) from error
    finally:
        pool.shutdown(cancel_futures=True)


def _begin(prepare: Callable[[Any], Callable[[Any], Any]], shared: Any) -> None:
    global _work
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_follow, args=(parent,), daemon=True).start()
    try:
        _work = prepare(shared)
    except Exception as error:  # raised here it would end the process, its reason lost
        _work = functools.partial(_refuse, error)


def _refuse(error: Exception, item: Any) -> None:
    raise error


def _follow(parent: Any) -> None:
    """A pool's processes hold each other's queue open: they would wait for a killed parent for ever."""
    parent.join()
    os._exit(1)


def _do(item: Any) -> Any:
    assert _work is not None
    return _work(item)


@contextmanager
def without_interrupts() -> Iterator[None]:
    """Processes started inside ignore SIGINT, even while they start; here it is handled afterwards."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def one_thread_in_children() -> Iterator[None]:
    """Processes started inside get one thread for linear algebra: the workers fill the CPUs already."""
    names = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
    before = {name: os.environ.get(name) for name in names}
    os.environ.update(dict.fromkeys(names, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value
