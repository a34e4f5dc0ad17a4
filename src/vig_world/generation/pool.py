"""Worker processes on this machine that outlive a killed one, are renewed, and stop cleanly."""

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
"""Samples a worker is given at a time."""
RENEWED_AFTER = 4000
"""Samples after which a worker makes way for a new process, so that no leak of a library adds up."""
ATTEMPTS = 3
"""So many workers may die at the same sample."""


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
        UserError: a file cannot be written, or the same sample killed its worker three times.
        RuntimeError: making a sample raised anything else; the message holds its traceback.
    """
    pool = _Pool(job, folder, missing, advance)
    try:
        with one_thread_in_children():
            pool.run(workers)
    finally:
        pool.stop()


class _Worker:
    """A process and what it is to make still."""

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
    """The parent's side: who makes what, and what happens when a worker answers or dies."""

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
        """Give a worker that has nothing to do the next chunk, a successor or leave to go."""
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
        except OSError:  # it died meanwhile; what it was given is in `waiting`
            self.bury(worker)

    def listen(self, worker: _Worker) -> None:
        try:
            index, trouble, is_users = worker.connection.recv()
        except (EOFError, OSError):
            self.bury(worker)
            return
        if trouble:
            raise UserError(trouble) if is_users else RuntimeError(f"sample {index}: {trouble}")
        assert worker.waiting.popleft() == index
        worker.made += 1
        self.advance(1)
        if not worker.waiting:
            self.feed(worker)

    def bury(self, worker: _Worker) -> None:
        """Put a dead worker's samples back and start another in its place."""
        worker.process.join()
        worker.connection.close()
        if worker in self.workers:
            self.workers.remove(worker)
        if worker.waiting:
            last = worker.waiting[0]
            self.deaths[last] += 1
            if self.deaths[last] >= ATTEMPTS:
                raise UserError(
                    f"sample {last}: its worker process was killed {ATTEMPTS} times, perhaps for want of"
                    " memory; what is done stays. Run the same command again, with fewer workers."
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
    """The worker's side: makes what it is sent, answers (index, trouble, is a UserError) for each sample."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the parent; a sample in progress is finished
    maker = Maker(job)
    try:
        while indices := connection.recv():
            for index in indices:
                if connection.poll():  # closed: the parent wants no more
                    return
                trouble, is_users = "", False
                try:
                    files = maker.make(index)
                    parent = multiprocessing.parent_process()
                    if parent is not None and not parent.is_alive():
                        return  # whoever takes its place may have finished by now
                    store(folder, files)
                except UserError as error:
                    trouble, is_users = str(error), True
                except Exception:
                    trouble = traceback.format_exc()
                connection.send((index, trouble, is_users))
                if trouble:
                    return
    except (EOFError, OSError):  # the parent has gone
        pass
    finally:
        maker.close()
