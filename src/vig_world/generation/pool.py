"""Samples made in this process, in several, or on a Ray cluster (the extra `cluster`)."""

import multiprocessing
import multiprocessing.util
import sys
from collections.abc import Callable, Generator
from contextlib import closing, nullcontext
from pathlib import Path

from vig.io.errors import UserError
from vig.parallel import Lost, map_as_done
from vig.parallel.cluster import map_on_cluster
from vig_world.generation.job import Failure, Job, Maker, store

Draw = tuple[int, int]
"""A sample's index and the number of its draw, see `vig_world.composition.sampling.sample`."""
HOPELESS = 16  # draws of which not one succeeds, after which a run ends
MAX_DRAWS = 100  # draws of one sample
CHUNK = 8  # samples in a task of a cluster: a few hundred kilobytes to send back


def make_samples(
    job: Job,
    folder: Path,
    missing: list[int],
    processes: int,
    advance: Callable[[int], None],
    address: str | None = None,
) -> None:
    """Make samples of a split: where a draw of one fails its next one is made, after the others.

    Failures are printed on standard error, but for scenes that cannot be composed. Ctrl-C lets each process
    finish the sample in progress; processes end by themselves when this one dies.

    Args:
        job: Recipe of the split.
        folder: Folder of the split.
        missing: Indices of the samples.
        processes: Number of processes; one that dies is replaced. Up to 1: this one makes them.
        advance: Called with the number of samples newly written.
        address: Address of a Ray cluster whose nodes make them, while this process alone writes them; `auto`:
            the one this machine belongs to.

    Raises:
        UserError: `HOPELESS` draws failed and none succeeded, or `MAX_DRAWS` of one sample failed; a file
            cannot be written; Ray is not installed, or there is no cluster.
    """
    waiting, made, failed = [(index, 0) for index in missing], 0, 0
    here = address is None and processes <= 1
    with closing(Maker(job)) if here else nullcontext() as maker:
        while waiting:
            again: list[Draw] = []
            with closing(_attempt(job, folder, waiting, processes, address, maker)) as outcomes:
                for place, failure in outcomes:
                    if failure is None:
                        made += 1
                        advance(1)
                        continue
                    failed += 1
                    index, draw = waiting[place]
                    if isinstance(failure, Lost):
                        failure = Failure(
                            f"sample {index}: its worker process was killed {failure.attempts} times,"
                            " possibly out of memory: use fewer workers"
                        )
                    if (failed >= HOPELESS and not made) or draw + 1 >= MAX_DRAWS:
                        raise UserError(
                            f"expected scenes that can be made; {failed} failed and {made} were made."
                            f" The last failure: {failure.reason}"
                        ) from (RuntimeError(failure.traceback) if failure.traceback else None)
                    if not failure.expected:
                        print(f"{failure.reason}; another scene takes its place", file=sys.stderr, flush=True)
                    again.append((index, draw + 1))
            waiting = sorted(again)


def _attempt(
    job: Job, folder: Path, draws: list[Draw], processes: int, address: str | None, maker: Maker | None
) -> Generator[tuple[int, Failure | Lost | None], None, None]:
    """Make draws; yield each one's place in the list, and the reason of its failure or None.

    maker: of this process, which makes them where one is given.
    """
    if maker is not None:
        for place, draw in enumerate(draws):
            yield place, store(folder, maker.make(*draw))
    elif address is not None:
        for place, made in map_on_cluster(_prepare_remote, job, draws, address, CHUNK):
            yield place, made if isinstance(made, Lost) else store(folder, made)
    else:
        yield from map_as_done(_prepare, (job, folder), draws, min(processes, len(draws)))


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


def _prepare_remote(job: Job) -> Callable[[Draw], dict[str, bytes] | Failure]:
    """Return the function that makes the files of a draw of a sample on a node."""
    maker = Maker(job)
    multiprocessing.util.Finalize(None, maker.close, exitpriority=1)
    return lambda draw: maker.make(*draw)
