"""The same job on a Ray cluster (the extra `cluster`): nodes make samples, the driver alone writes them."""

from __future__ import annotations

import multiprocessing.util
import traceback
from collections.abc import Callable
from pathlib import Path

from vig.errors import UserError
from vig.parallel import Lost
from vig.parallel.cluster import map_on_cluster
from vig_world.generation.job import Advance, Job, Maker, store

CHUNK = 8
"""Samples in a task: a few hundred kilobytes to send back."""


def make_on_ray(job: Job, folder: Path, missing: list[int], address: str, advance: Advance) -> None:
    """Make the samples on the cluster at `address` (`auto`: the one this machine belongs to).

    Raises:
        UserError: Ray is not installed, there is no cluster, a file cannot be written, or a task's workers
            died again and again.
        RuntimeError: Making a sample raised anything else.
    """
    for number, files in map_on_cluster(_prepare, job, missing, address, CHUNK):
        if isinstance(files, Lost):
            raise UserError(
                f"sample {missing[number]} was lost {files.attempts} times on the cluster; finished samples"
                " are kept. Run the same command again."
            )
        store(folder, files)
        advance(1)


def _prepare(job: Job) -> Callable[[int], dict[str, bytes]]:
    """On a node: makes the files of a sample."""
    maker = Maker(job)
    multiprocessing.util.Finalize(None, maker.close, exitpriority=1)

    def work(index: int) -> dict[str, bytes]:
        try:
            return maker.make(index)
        except UserError:
            raise
        except Exception:
            raise RuntimeError(f"sample {index}: {traceback.format_exc()}") from None

    return work
