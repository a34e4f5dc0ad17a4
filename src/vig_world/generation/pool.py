"""Worker processes on this machine: dead ones are replaced, old ones renewed, all stop cleanly."""

from __future__ import annotations

import multiprocessing
import signal
import traceback
from collections import Counter, deque
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from pathlib import Path

from vig.errors import UserError
from vig.parallel.processes import one_thread_in_children, without_interrupts
from vig_world.generation.job import Advance, Job, Maker, store

CHUNK = 8
"""Samples sent to a worker at a time."""
RENEWED_AFTER = 4000
"""Samples after which a worker is replaced by a new process, which bounds memory leaks in libraries."""
ATTEMPTS = 3
"""Number of workers that may die at the same sample."""


def make_here(job: Job, folder: Path, missing: list[int], advance: Advance) -> None:
    """Make the samples in this process."""
    maker = Maker(job)
    try:
        for index in missing:
            store(folder, maker.make(index))
            advance(1)
    finally:
        maker.close()


def make_in_processes(job: Job, folder: Path, missing: list[int], workers: int, advance: Advance) -> None:
    """Make the samples in `workers` processes; a process that dies is replaced and its samples made again.

    Ctrl-C lets each worker finish the sample in progress. Workers end by themselves when this process dies.

    Raises:
        UserError: A file cannot be written, or the same sample killed its worker three times.
        RuntimeError: Making a sample raised anything else; the message holds its traceback.
    """
    pool = _Pool(job, folder, missing, advance)
    try:
        with one_thread_in_children():
            pool.run(workers)
    finally:
        pool.stop()


class _Worker:
    """A process and the samples it has yet to make."""

    def __init__(self, job: Job, folder: Path) -> None:
        context = multiprocessing.get_context("spawn")
        self.connection, theirs = context.Pipe()
        self.process: BaseProcess = context.Process(target=_work, args=(theirs, job, folder), daemon=False)
        with without_interrupts():
            self.process.start()
        theirs.close()
        self.waiting: deque[int] = deque()
        self.made = 0

    def give(self, indices: list[int]) -> None:
        self.waiting.extend(indices)
        self.connection.send(indices)


class _Pool:
    """The parent's side: assigns samples, and reacts when a worker answers or dies."""

    def __init__(self, job: Job, folder: Path, missing: list[int], advance: Advance) -> None:
        self.job, self.folder, self.advance = job, folder, advance
        self.chunks = deque(missing[i : i + CHUNK] for i in range(0, len(missing), CHUNK))
        self.workers: list[_Worker] = []
        self.deaths: Counter[int] = Counter()

    def run(self, workers: int) -> None:
        for _ in range(min(workers, len(self.chunks))):
            self.start()
        while self.workers:
            by_connection = {worker.connection: worker for worker in self.workers}
            for ready in wait(list(by_connection)):
                assert isinstance(ready, Connection)
                self.listen(by_connection[ready])

    def start(self) -> None:
        worker = _Worker(self.job, self.folder)
        self.workers.append(worker)
        self.feed(worker)

    def feed(self, worker: _Worker) -> None:
        """Send an idle worker the next chunk, or end it, with a successor if samples remain."""
        try:
            if not self.chunks or worker.made >= RENEWED_AFTER:
                self.workers.remove(worker)
                worker.connection.send(None)
                worker.process.join()
                worker.connection.close()
                if self.chunks:
                    self.start()
            else:
                worker.give(self.chunks.popleft())
        except OSError:  # it has died; its samples are in `waiting`
            self.bury(worker)

    def listen(self, worker: _Worker) -> None:
        try:
            index, failure, is_users = worker.connection.recv()
        except (EOFError, OSError):
            self.bury(worker)
            return
        if failure:
            raise UserError(failure) if is_users else RuntimeError(f"sample {index}: {failure}")
        assert worker.waiting.popleft() == index
        worker.made += 1
        self.advance(1)
        if not worker.waiting:
            self.feed(worker)

    def bury(self, worker: _Worker) -> None:
        """Requeue a dead worker's samples and start a replacement."""
        worker.process.join()
        worker.connection.close()
        if worker in self.workers:
            self.workers.remove(worker)
        if worker.waiting:
            last = worker.waiting[0]
            self.deaths[last] += 1
            if self.deaths[last] >= ATTEMPTS:
                raise UserError(
                    f"sample {last}: its worker process was killed {ATTEMPTS} times, possibly out of"
                    " memory; finished samples are kept. Run the same command again with fewer workers."
                )
            self.chunks.appendleft(list(worker.waiting))
        if self.chunks:
            self.start()

    def stop(self) -> None:
        """Let every worker finish its sample, and wait for it."""
        for worker in self.workers:
            worker.connection.close()
        for worker in self.workers:
            worker.process.join()


def _work(connection: Connection, job: Job, folder: Path) -> None:
    """The worker's side: makes what it is sent, answers (index, failure, is a UserError) for each sample."""
    signal.signal(
        signal.SIGINT, signal.SIG_IGN
    )  # the parent handles Ctrl-C; a sample in progress is finished
    maker = Maker(job)
    try:
        while indices := connection.recv():
            for index in indices:
                if connection.poll():  # the parent has closed it to stop this worker
                    return
                failure, is_users = "", False
                try:
                    files = maker.make(index)
                    parent = multiprocessing.parent_process()
                    if parent is not None and not parent.is_alive():
                        return  # another run may have completed the dataset by now
                    store(folder, files)
                except UserError as error:
                    failure, is_users = str(error), True
                except Exception:
                    failure = traceback.format_exc()
                connection.send((index, failure, is_users))
                if failure:
                    return
    except (EOFError, OSError):  # the parent has ended
        pass
    finally:
        maker.close()
