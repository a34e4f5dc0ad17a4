"""Work shared out to processes of this machine: where Python's lock would keep threads waiting.

Processes that die are replaced, and their items are done by others.
"""

import multiprocessing
import os
import signal
import sys
import threading
import traceback
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing.reduction import ForkingPickler
from pathlib import Path
from typing import Any, Generic, TypeVar

from vig.io.errors import UserError
from vig.parallel.internals import process_of

Item = TypeVar("Item")
Result = TypeVar("Result")

AHEAD = 2  # items handed out at once to each process: enough that none waits, and few copies of their arrays
WINDOW = 16  # items of each process by which one may be ahead of the oldest that is not done
ATTEMPTS = 3  # processes that may die of one item
RENEWED_AFTER = 4000
"""Items after which a process is replaced by a new one, which bounds memory leaks in libraries."""
UNGUARDED = 78  # exit code of a process that asked for processes itself as it imported the program


@dataclass(frozen=True)
class Lost:
    """Stands for an item's result: `attempts` processes died of it."""

    attempts: int


def map_in_processes(
    prepare: Callable[[Any], Callable[[Item], Result]], shared: Any, items: Iterable[Item], processes: int
) -> Iterator[Result]:
    """Yield work(item) of each item in order; see `map_as_done`.

    Raises:
        UserError: `ATTEMPTS` processes were killed at the same item, or none can start.
        Exception: The exception of `prepare` or work.
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
    prepare: Callable[[Any], Callable[[Item], Result]], shared: Any, items: Iterable[Item], processes: int
) -> Iterator[tuple[int, Result | Lost]]:
    """Yield number and work(item) of items as they are done, work being each process's `prepare(shared)`.

    Each process has one thread for linear algebra, ignores SIGINT, and ends when this process dies. One that
    is killed is replaced; another does its items. If the consumer stops early, processes finish their items.

    Args:
        prepare: A function of a module, no closure: processes are spawned and import it.
        shared: Its argument.
        items: They and their results hold arrays: tensors would go through shared memory.
        processes: Number of processes.

    Raises:
        UserError: Processes end while they import the program's main module.
        Exception: The exception of `prepare` or work.
    """
    check_main_module()
    pool = _Pool(prepare, shared, items, processes)
    try:
        yield from pool.run()
    finally:
        pool.stop()


@dataclass
class _Submitted(Generic[Item]):
    number: int
    item: Item
    attempts: int = 0


class _WorkerProcess:
    """A process in an executor of its own, so that one that dies breaks no other's futures."""

    def __init__(self, prepare: Callable[[Any], Callable[[Any], Any]], shared: Any) -> None:
        context = multiprocessing.get_context("spawn")
        self.stopping = context.Event()
        self.executor = ProcessPoolExecutor(1, context, _initialise, (self.stopping,))
        with one_thread_in_children(), without_interrupts():
            self.begun = self.executor.submit(_begin, bytes(ForkingPickler.dumps((prepare, shared))))
        self.process = process_of(self.executor)
        self.tasks: deque[_Submitted[Any]] = deque()
        self.done = 0

    def submit(self, task: _Submitted[Any]) -> Future[tuple[bool, Any]]:
        """Queue a task. BrokenProcessPool when the process has died."""
        self.tasks.append(task)
        return self.executor.submit(_do, bytes(ForkingPickler.dumps(task.item)))

    def ended_by_itself(self) -> int | None:
        """Return the exit code of a process that ended before it could begin, not by a signal; else None."""
        began = self.begun.done() and self.begun.exception() is None
        if began or self.process is None:
            return None
        self.process.join()
        code = self.process.exitcode
        return code if code is not None and code >= 0 else None


class _Pool:
    """Hands tasks out, and reacts when a process answers or dies."""

    def __init__(
        self, prepare: Callable[[Any], Callable[[Any], Any]], shared: Any, items: Iterable[Any], count: int
    ) -> None:
        self.prepare, self.shared, self.count = prepare, shared, count
        self.items = iter(enumerate(items))
        self.again: deque[_Submitted[Any]] = deque()
        self.next: _Submitted[Any] | None = None
        self.exhausted = False
        self.workers: list[_WorkerProcess] = []
        self.pending: dict[Future[tuple[bool, Any]], _WorkerProcess] = {}

    def run(self) -> Iterator[tuple[int, Any]]:
        while True:
            yield from self.hand_out()
            if not self.pending:
                return
            wait(self.pending, return_when=FIRST_COMPLETED)
            for future in [future for future in self.pending if future.done()]:  # in the order of submission
                if (worker := self.pending.pop(future, None)) is None:
                    continue  # from a process that has died
                try:
                    succeeded, answer = future.result()
                except BrokenProcessPool:
                    yield from self.bury(worker)
                    continue
                task = worker.tasks.popleft()
                worker.done += 1
                if not succeeded:
                    raise answer
                yield task.number, answer

    def upcoming(self) -> _Submitted[Any] | None:
        """Return the task to hand out next; None when there is none, or it would be too far ahead."""
        if self.again:
            return self.again[0]
        if self.next is None:
            number, item = next(self.items, (-1, None))
            self.exhausted = number < 0
            self.next = None if self.exhausted else _Submitted(number, item)
        oldest = min((worker.tasks[0].number for worker in self.workers if worker.tasks), default=None)
        if self.next is not None and oldest is not None and self.next.number > oldest + WINDOW * self.count:
            return None
        return self.next

    def hand_out(self) -> Iterator[tuple[int, Any]]:
        """Keep every process busy, with a new one where there are too few; end idle ones."""
        for worker in [*self.workers]:
            full = RENEWED_AFTER - worker.done
            while worker in self.workers and len(worker.tasks) < min(AHEAD, full) and self.upcoming():
                yield from self.give(worker)
            if worker in self.workers and not worker.tasks:
                self.workers.remove(worker)
                worker.executor.shutdown()
        while len(self.workers) < self.count and self.upcoming():
            self.workers.append(_WorkerProcess(self.prepare, self.shared))
            yield from self.give(self.workers[-1])

    def give(self, worker: _WorkerProcess) -> Iterator[tuple[int, Any]]:
        """Hand out the upcoming task; yield tasks that are lost meanwhile."""
        task = self.upcoming()
        assert task is not None
        if self.again:
            self.again.popleft()
        else:
            self.next = None
        try:
            self.pending[worker.submit(task)] = worker
        except BrokenProcessPool:
            yield from self.bury(worker)

    def bury(self, worker: _WorkerProcess) -> Iterator[tuple[int, Any]]:
        """Take back the tasks of a process that died, perhaps of the first; yield that if it is lost."""
        self.workers.remove(worker)
        self.pending = {future: other for future, other in self.pending.items() if other is not worker}
        worker.executor.shutdown()
        if (code := worker.ended_by_itself()) is not None:
            end = "asked for processes itself" if code == UNGUARDED else f"ended with exit code {code}"
            raise _no_start(f"one imported the program's main module and it {end}") from None
        first = worker.tasks[0]
        first.attempts += 1
        if first.attempts >= ATTEMPTS:
            worker.tasks.popleft()
            yield first.number, Lost(first.attempts)
        self.again.extendleft(reversed(worker.tasks))

    def stop(self) -> None:
        """Let every process finish its task, and wait for it."""
        for worker in self.workers:
            worker.stopping.set()
        for worker in self.workers:
            worker.executor.shutdown(cancel_futures=True)


_stopping: Any = None
_work: Callable[[Any], Any] | None = None


def _initialise(stopping: Any) -> None:
    """End a new process with its parent, not by Ctrl-C."""
    global _stopping
    _stopping = stopping
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_follow, args=(multiprocessing.parent_process(),), daemon=True).start()


def _begin(start: bytes) -> None:
    """Make the work of a new process from (prepare, shared); each task raises its exception."""
    global _work
    try:
        prepare, shared = ForkingPickler.loads(start)
        _work = prepare(shared)
    except Exception as error:
        refused = error

        def refuse(item: Any) -> Any:
            raise refused

        _work = refuse


def _do(packed: bytes) -> tuple[bool, Any]:
    """Return whether an item succeeded, with the result or the error."""
    assert _work is not None
    if _stopping.is_set():
        return True, None
    try:
        return True, _work(ForkingPickler.loads(packed))
    except Exception as error:
        return False, _sendable(error)


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


def _sendable(error: Exception) -> Exception:
    """Return the error as it can be sent, with where it was raised; a library's becomes a RuntimeError."""
    if isinstance(error, UserError):
        return error
    trace = "".join(traceback.format_exception(error))
    if type(error).__module__ != "builtins":
        error = RuntimeError(f"{type(error).__name__}: {error}")
    error.add_note(trace)
    return error


def _follow(parent: Any) -> None:
    """End this process with its parent: a busy one would outlive a killed parent."""
    parent.join()
    os._exit(1)


@contextmanager
def without_interrupts() -> Iterator[None]:
    """Let processes started inside ignore SIGINT, even while they start; here it is handled afterwards."""
    blocked_before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, blocked_before)


@contextmanager
def one_thread_in_children() -> Iterator[None]:
    """Give processes started inside one thread for linear algebra: the workers fill the CPUs already."""
    names = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
    values_before = {name: os.environ.get(name) for name in names}
    os.environ.update(dict.fromkeys(names, "1"))
    try:
        yield
    finally:
        for name, value in values_before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value
