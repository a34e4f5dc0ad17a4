"""Samples made on this machine, in this process or in several."""

from __future__ import annotations

import multiprocessing
import multiprocessing.util
import traceback
from collections.abc import Callable
from pathlib import Path

from vig.errors import UserError
from vig.parallel import Lost, map_as_done
from vig_world.generation.job import Advance, Job, Maker, store


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
    for number, lost in map_as_done(_prepare, (job, folder), missing, min(workers, len(missing))):
        if isinstance(lost, Lost):
            raise UserError(
                f"sample {missing[number]}: its worker process was killed {lost.attempts} times, possibly out"
                " of memory; finished samples are kept. Run the same command again with fewer workers."
            )
        advance(1)


def _prepare(shared: tuple[Job, Path]) -> Callable[[int], None]:
    """The work of a process: make a sample and write its files."""
    job, folder = shared
    maker, parent = Maker(job), multiprocessing.parent_process()
    multiprocessing.util.Finalize(None, maker.close, exitpriority=1)  # these processes run no atexit

    def work(index: int) -> None:
        try:
            files = maker.make(index)
            if parent is None or parent.is_alive():  # else another run may have completed the dataset by now
                store(folder, files)
        except UserError:
            raise
        except Exception:
            raise RuntimeError(f"sample {index}: {traceback.format_exc()}") from None

    return work
