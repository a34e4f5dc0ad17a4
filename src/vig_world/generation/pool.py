"""Samples made in this process, in several, or on a Ray cluster (the extra `cluster`)."""

from __future__ import annotations

import multiprocessing
import multiprocessing.util
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

from vig.io.errors import UserError
from vig.parallel import Lost, map_as_done
from vig.parallel.cluster import map_on_cluster
from vig_world.generation.job import Failure, Job, Maker, store

Draw = tuple[int, int]
"""A sample's index and the number of its draw, see `vig_world.composition.sampling.sample`."""
HOPELESS = 16
"""Draws of which not one succeeds, after which a run ends."""
MOST_DRAWS = 100
"""Draws of one sample."""
CHUNK = 8
"""Samples in a task of a cluster: a few hundred kilobytes to send back."""


def make_samples(
    missing: list[int],
    attempt: Callable[[list[Draw]], Iterator[tuple[int, Failure | Lost | None]]],
    advance: Callable[[int], None],
) -> None:
    """Have samples made: where a draw of one fails its next one is made, after the others.

    Failures are printed on standard error, but for scenes that cannot be composed.

    Args:
        missing: Indices of the samples.
        attempt: Makes draws; yields each one's place in the list, and the reason of its failure or None.
        advance: Called with the number of samples newly written.

    Raises:
        UserError: `HOPELESS` draws failed and none succeeded, or `MOST_DRAWS` of one sample failed.
    """
    waiting, made, failed = [(index, 0) for index in missing], 0, 0
    while waiting:
        again: list[Draw] = []
        for place, outcome in attempt(waiting):
            if outcome is None:
                made += 1
                advance(1)
                continue
            failed += 1
            (index, draw), failure = waiting[place], outcome
            if isinstance(failure, Lost):
                failure = Failure(
                    f"sample {index}: its worker process was killed {failure.attempts} times, possibly out of"
                    " memory: use fewer workers"
                )
            if (failed >= HOPELESS and not made) or draw + 1 >= MOST_DRAWS:
                raise UserError(
                    f"expected scenes that can be made; {failed} failed and {made} were made. The last"
                    f" failure: {failure.reason}"
                ) from (RuntimeError(failure.traceback) if failure.traceback else None)
            if not failure.expected:
                print(f"{failure.reason}; another scene takes its place", file=sys.stderr, flush=True)
            again.append((index, draw + 1))
        waiting = sorted(again)


def make_here(job: Job, folder: Path, missing: list[int], advance: Callable[[int], None]) -> None:
    """Make the samples in this process; see `make_samples`."""
    maker = Maker(job)

    def attempt(draws: list[Draw]) -> Iterator[tuple[int, Failure | None]]:
        for place, draw in enumerate(draws):
            yield place, store(folder, maker.make(*draw))

    try:
        make_samples(missing, attempt, advance)
    finally:
        maker.close()


def make_in_processes(
    job: Job, folder: Path, missing: list[int], workers: int, advance: Callable[[int], None]
) -> None:
    """Make the samples in `workers` processes; one that dies is replaced. See `make_samples`.

    Ctrl-C lets each worker finish the sample in progress. Workers end by themselves when this process dies.

    Raises:
        UserError: A file cannot be written, or as `make_samples`.
    """

    def attempt(draws: list[Draw]) -> Iterator[tuple[int, Failure | Lost | None]]:
        return map_as_done(_prepare, (job, folder), draws, min(workers, len(draws)))

    make_samples(missing, attempt, advance)


def _prepare(shared: tuple[Job, Path]) -> Callable[[Draw], Failure | None]:
    """Return the work of a process: make a draw of a sample and write its files."""
    job, folder = shared
    maker, parent = Maker(job), multiprocessing.parent_process()
    multiprocessing.util.Finalize(None, maker.close, exitpriority=1)  # these processes run no atexit

    def work(draw: Draw) -> Failure | None:
        made = maker.make(*draw)
        if parent is None or parent.is_alive():  # else another run may have completed the dataset by now
            return store(folder, made)
        return None

    return work


def make_on_ray(
    job: Job, folder: Path, missing: list[int], address: str, advance: Callable[[int], None]
) -> None:
    """Make the samples on the cluster at `address` (`auto`: the one this machine belongs to).

    Its nodes make them, and this process alone writes them.

    Raises:
        UserError: Ray is not installed, there is no cluster, a file cannot be written, or as `make_samples`.
    """

    def attempt(draws: list[Draw]) -> Iterator[tuple[int, Failure | Lost | None]]:
        for place, made in map_on_cluster(_prepare_remote, job, draws, address, CHUNK):
            yield place, made if isinstance(made, Lost) else store(folder, made)

    make_samples(missing, attempt, advance)


def _prepare_remote(job: Job) -> Callable[[Draw], dict[str, bytes] | Failure]:
    """Return the function that makes the files of a draw of a sample on a node."""
    maker = Maker(job)
    multiprocessing.util.Finalize(None, maker.close, exitpriority=1)
    return lambda draw: maker.make(*draw)
