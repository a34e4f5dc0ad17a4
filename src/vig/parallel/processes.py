"""Work shared out to processes of this machine: where Python's lock would keep threads waiting.

Processes that die are replaced, and what they had to do is done by others.
"""

from __future__ import annotations

import functools
import multiprocessing
import os
import queue
import signal
import sys
import threading
import traceback
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any, Generic, TypeVar

from vig.io.errors import UserError

Given = TypeVar("Given")
Result = TypeVar("Result")

AHEAD = 2
"""Items handed out at once to each process: enough that none waits, and few copies of what they hold."""
WINDOW = 16
"""Items of each process by which one may be ahead of the oldest that is not done."""
ATTEMPTS = 3
"""Processes that may die of one item."""
RENEWED_AFTER = 4000
"""Items after which a process is replaced by a new one, which bounds memory leaks in libraries."""
READY = -1
"""Number of the message by which a process says that it has begun."""
UNGUARDED = 78
"""Exit code of a process that asked for processes itself as it imported the program."""


@dataclass(frozen=True)
class Lost:
    """In place of an item's result: so many processes died of it."""

    attempts: int


def map_in_processes(
    prepare: Callable[[Any], Callable[[Given], Result]], shared: Any, items: Iterable[Given], processes: int
) -> Iterator[Result]:
    """work(item) of each item in order; see `map_as_done`.

    Raises:
        UserError: `ATTEMPTS` processes were killed at the same item, or none can start.
        Exception: What `prepare` or work raised.
    """
    done: dict[int, Result] = {}
    expected = 0
    for number, result in map_as_done(prepare, shared, items, processes):
        if isinstance(result, Lost):
            raise UserError(
                f"a worker process was killed {result.attempts} times at the same item, possibly out of"
                " memory; what is done stays. Run it again with fewer workers."
            )
        done[number] = result
        while expected in done:
            yield done.pop(expected)
            expected += 1


def map_as_done(
    prepare: Callable[[Any], Callable[[Given], Result]], shared: Any, items: Iterable[Given], processes: int
) -> Iterator[tuple[int, Result | Lost]]:
    """Number and work(item) of each item as they are done, work being each process's `prepare(shared)`.

    Each process has one thread for linear algebra, ignores SIGINT, and ends when this process dies. One that
    is killed is replaced; another does its items. When the consumer stops early, each process finishes its
    item.

    Args:
        prepare: A function of a module, no closure: processes are spawned and import it.
        shared: What it gets.
        items: They and their results hold arrays, not tensors, which torch would send through shared memory.
        processes: How many.

    Raises:
        UserError: Processes end while they import the program's main module.
        Exception: What `prepare` or work raised.
    """
    check_main_module()
    pool = _Pool(prepare, shared, items, processes)
    try:
        yield from pool.run()
    finally:
        pool.stop()


@dataclass
class _Item(Generic[Given]):
    number: int
    given: Given
    attempts: int = 0


class _Worker:
    """A process, and the items that it has yet to do. It is sent nothing before it says that it has begun:
    a process that ends as it starts would leave this one waiting to send.
    """

    def __init__(self) -> None:
        context = multiprocessing.get_context("spawn")
        self.connection, theirs = context.Pipe()
        self.process: BaseProcess = context.Process(target=_serve, args=(theirs,))
        with one_thread_in_children(), without_interrupts():
            self.process.start()
        theirs.close()
        self.waiting: deque[_Item[Any]] = deque()
        self.ready, self.done = False, 0

    def give(self, item: _Item[Any]) -> None:
        self.waiting.append(item)
        if self.ready:
            self.connection.send((item.number, item.given))

    def begin(self, prepare: Callable[[Any], Callable[[Any], Any]], shared: Any) -> None:
        self.ready = True
        self.connection.send((prepare, shared))
        for item in self.waiting:
            self.connection.send((item.number, item.given))


class _Pool:
    """The parent's side: hands items out, and reacts when a process answers or dies."""

    def __init__(
        self, prepare: Callable[[Any], Callable[[Any], Any]], shared: Any, items: Iterable[Any], count: int
    ) -> None:
        self.prepare, self.shared, self.count = prepare, shared, count
        self.items = iter(enumerate(items))
        self.again: deque[_Item[Any]] = deque()
        self.handed: set[int] = set()
        self.next: _Item[Any] | None = None
        self.exhausted = False
        self.workers: list[_Worker] = []

    def run(self) -> Iterator[tuple[int, Any]]:
        while True:
            yield from self.hand_out()
            if not self.workers:
                return
            by_connection = {worker.connection: worker for worker in self.workers}
            for ready in wait(list(by_connection)):
                assert isinstance(ready, Connection)
                worker = by_connection[ready]
                try:
                    number, succeeded, answer = ready.recv()
                    if number == READY:
                        worker.begin(self.prepare, self.shared)
                        continue
                except (EOFError, OSError):
                    yield from self.bury(worker)
                    continue
                assert worker.waiting.popleft().number == number
                self.handed.remove(number)
                worker.done += 1
                if not succeeded:
                    raise answer
                yield number, answer

    def upcoming(self) -> _Item[Any] | None:
        """The item to hand out next; None when there is none, or it would be too far ahead."""
        if self.again:
            return self.again[0]
        if self.next is None:
            number, given = next(self.items, (-1, None))
            self.exhausted = number < 0
            self.next = None if self.exhausted else _Item(number, given)
        oldest = min(self.handed, default=None)
        if self.next is not None and oldest is not None and self.next.number > oldest + WINDOW * self.count:
            return None
        return self.next

    def hand_out(self) -> Iterator[tuple[int, Any]]:
        """Keep every process busy, with a new one where there are too few; end those that have nothing."""
        for worker in [*self.workers]:
            while (
                len(worker.waiting) < AHEAD
                and worker.done + len(worker.waiting) < RENEWED_AFTER
                and self.upcoming()
            ):
                if not self.give(worker):
                    yield from self.bury(worker)
                    break
            spent = worker.done >= RENEWED_AFTER or (self.exhausted and not self.again)
            if worker in self.workers and not worker.waiting and spent:
                self.workers.remove(worker)
                self.end(worker)
        while len(self.workers) < self.count and self.upcoming():
            worker = _Worker()
            self.workers.append(worker)
            if not self.give(worker):
                yield from self.bury(worker)

    def give(self, worker: _Worker) -> bool:
        """Hand the upcoming item out; False when the process has died."""
        item = self.upcoming()
        assert item is not None
        if self.again:
            self.again.popleft()
        else:
            self.next = None
        self.handed.add(item.number)
        try:
            worker.give(item)
        except OSError:
            return False
        return True

    def bury(self, worker: _Worker) -> Iterator[tuple[int, Any]]:
        """Take back the items of a process that died; the first one it may have died of."""
        self.workers.remove(worker)
        worker.process.join()
        worker.connection.close()
        code = worker.process.exitcode or 0
        if not worker.ready and code >= 0:  # ended by itself, not by a signal
            end = "asked for processes itself" if code == UNGUARDED else f"ended with exit code {code}"
            raise _no_start(f"one imported the program's main module and it {end}") from None
        if worker.waiting:
            first = worker.waiting[0]
            first.attempts += 1
            if first.attempts >= ATTEMPTS:
                worker.waiting.popleft()
                self.handed.remove(first.number)
                yield first.number, Lost(first.attempts)
        self.again.extendleft(reversed(worker.waiting))

    @staticmethod
    def end(worker: _Worker) -> None:
        worker.connection.close()
        worker.process.join()

    def stop(self) -> None:
        """Let every process finish its item, and wait for it."""
        for worker in self.workers:
            worker.connection.close()
        for worker in self.workers:
            worker.process.join()


def _serve(connection: Connection) -> None:
    """The child's side: is sent (prepare, shared), then items, each answered by (number, whether it
    succeeded, result or error).
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with suppress(OSError):  # the parent may have stopped meanwhile
        connection.send((READY, True, None))
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_follow, args=(parent,), daemon=True).start()
    try:
        prepare, shared = connection.recv()
        work = prepare(shared)
    except Exception as error:  # raised here it would end the process, its reason lost
        work = functools.partial(_refuse, error)
    given: queue.Queue[Any] = queue.Queue()
    ended = threading.Event()
    threading.Thread(target=_receive, args=(connection, given, ended), daemon=True).start()
    while (received := given.get()) is not None and not ended.is_set():
        number, item = received
        try:
            answer = number, True, work(item)
        except Exception as error:
            answer = number, False, _sendable(error)
        try:
            connection.send(answer)
        except OSError:  # the parent has stopped
            return


def check_main_module() -> None:
    """Refuse a program that worker processes cannot import; to be called before anything is written.

    A spawned process imports the program's main module. Where that asks for processes again, outside of
    `if __name__ == "__main__"`, the process ends silently with `UNGUARDED`, which its parent reports.

    Raises:
        UserError: The main module is no file, as that of a program read from standard input.
    """
    if getattr(multiprocessing.current_process(), "_inheriting", False):
        os._exit(UNGUARDED)
    main = sys.modules["__main__"]
    file = getattr(main, "__file__", None)
    if getattr(main, "__spec__", None) is None and file is not None and not Path(file).exists():
        raise _no_start(f"they cannot import the program's main module, as '{file}' is no file")


def _no_start(got: str) -> UserError:
    return UserError(
        f"expected worker processes to start, but {got}. Save the program as a file and put what asks for"
        " workers under `if __name__ == '__main__':`, or use one worker."
    )


def _receive(connection: Connection, given: queue.Queue[Any], ended: threading.Event) -> None:
    """Take what is sent at once: a parent that waits to send while we wait to answer would wait for ever."""
    try:
        while True:
            given.put(connection.recv())
    except (EOFError, OSError):
        ended.set()
        given.put(None)


def _sendable(error: Exception) -> Exception:
    """The error as it can be sent, with where it was raised; that of a library becomes a RuntimeError."""
    if isinstance(error, UserError):
        return error
    told = "".join(traceback.format_exception(error))
    if type(error).__module__ != "builtins":
        error = RuntimeError(f"{type(error).__name__}: {error}")
    error.add_note(told)
    return error


def _refuse(error: Exception, item: Any) -> None:
    raise error


def _follow(parent: Any) -> None:
    """A process that is busy would outlive a killed parent."""
    parent.join()
    os._exit(1)


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
