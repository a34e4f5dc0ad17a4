"""The same job on a Ray cluster (the extra `cluster`): nodes make samples, the driver alone writes them."""

from __future__ import annotations

import multiprocessing.util
from collections.abc import Callable, Iterator
from pathlib import Path

from vig.parallel import Lost
from vig.parallel.cluster import map_on_cluster
from vig_world.generation.job import Failure, Job, Maker, store
from vig_world.generation.pool import Draw, make_samples

CHUNK = 8
"""Samples in a task: a few hundred kilobytes to send back."""


def make_on_ray(
    job: Job, folder: Path, missing: list[int], address: str, advance: Callable[[int], None]
) -> None:
    """Make the samples on the cluster at `address` (`auto`: the one this machine belongs to).

    Raises:
        UserError: Ray is not installed, there is no cluster, a file cannot be written, or as `make_samples`.
    """

    def attempt(draws: list[Draw]) -> Iterator[tuple[int, Failure | Lost | None]]:
        for place, made in map_on_cluster(_prepare, job, draws, address, CHUNK):
            yield place, made if isinstance(made, Lost) else store(folder, made)

    make_samples(missing, attempt, advance)


def _prepare(job: Job) -> Callable[[Draw], dict[str, bytes] | Failure]:
    """Return the function that makes the files of a draw of a sample on a node."""
    maker = Maker(job)
    multiprocessing.util.Finalize(None, maker.close, exitpriority=1)
    return lambda draw: maker.make(*draw)
