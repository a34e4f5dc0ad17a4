"""The same job on a Ray cluster (the [cluster] extra): nodes make samples, the driver alone writes them."""

from __future__ import annotations

import socket
from collections import Counter, deque
from pathlib import Path
from typing import Any

from vig.errors import UserError
from vig_world.extras import optional_import
from vig_world.generation.job import Advance, Job, Maker, store

CHUNK = 8
"""Samples in a task: a few hundred kilobytes to send back."""
TASKS_PER_CPU = 2
"""Tasks in progress or queued for each processor of the cluster."""
RETRIES = 5
"""Times that Ray retries a task whose worker or node has died, and the driver a task that Ray gave up."""
ANSWER_SECONDS = 5.0
RENEWED_AFTER = 500
"""Tasks after which a worker process is replaced."""


def make_on_ray(job: Job, folder: Path, missing: list[int], address: str, advance: Advance) -> None:
    """Make the samples on the cluster at `address` (`auto`: the one this machine belongs to).

    The nodes need vig installed, but no shared disk: samples return as bytes and are written here. A task
    whose worker or node dies is retried elsewhere.

    Raises:
        UserError: Ray is not installed, there is no cluster, a file cannot be written, or a task's workers
            died again and again.
        RuntimeError: making a sample raised anything else.
    """
    require_ray()
    import ray

    ours = not ray.is_initialized()
    if ours:
        _check_answers(address)
        try:
            ray.init(address=address, log_to_driver=False, logging_level="error")
        except (ConnectionError, ValueError, RuntimeError) as error:
            raise _no_cluster(address, error) from error
    try:
        _run(ray, job, folder, missing, advance)
    finally:
        if ours:
            ray.shutdown()


def require_ray() -> None:
    """Raise UserError when Ray is not installed."""
    with optional_import("cluster"):
        import ray  # noqa: F401


def _check_answers(address: str) -> None:
    """Refuse an address where nothing listens within seconds; Ray itself takes minutes."""
    host, _, port = address.removeprefix("ray://").rpartition(":")
    if host and port.isdigit():
        try:
            socket.create_connection((host, int(port)), timeout=ANSWER_SECONDS).close()
        except (OSError, OverflowError) as error:
            raise _no_cluster(address, error) from error


def _no_cluster(address: str, error: Exception) -> UserError:
    return UserError(
        f"no Ray cluster answers at '{address}' ({_first_line(error)}); start one with"
        " `ray start --head`, or leave out --ray."
    )


def _run(ray: Any, job: Job, folder: Path, missing: list[int], advance: Advance) -> None:
    make = ray.remote(num_cpus=1, max_retries=RETRIES, max_calls=RENEWED_AFTER)(_make)
    shared = ray.put(job)
    chunks = deque(tuple(missing[i : i + CHUNK]) for i in range(0, len(missing), CHUNK))
    running: dict[Any, tuple[int, ...]] = {}
    losses: Counter[int] = Counter()
    while chunks or running:
        limit = TASKS_PER_CPU * max(1, int(ray.cluster_resources().get("CPU", 1)))
        while chunks and len(running) < limit:
            chunk = chunks.popleft()
            running[make.remote(shared, chunk)] = chunk
        for done in ray.wait(list(running), timeout=1.0)[0]:
            chunk = running.pop(done)
            try:
                samples = ray.get(done)
            except ray.exceptions.RayTaskError as error:
                if isinstance(error.cause, UserError):
                    raise UserError(str(error.cause)) from error
                if isinstance(error.cause, ModuleNotFoundError):
                    raise UserError(
                        f"a node of the cluster lacks a package ({_first_line(error.cause)});"
                        " install vig on every node."
                    ) from error
                raise RuntimeError(f"samples {chunk[0]} to {chunk[-1]}: {error}") from error
            except ray.exceptions.RayError as error:  # worker, node or result lost
                losses[chunk[0]] += 1
                if losses[chunk[0]] > RETRIES:
                    raise UserError(
                        f"samples {chunk[0]} to {chunk[-1]} were lost {RETRIES} times on the cluster"
                        f" ({_first_line(error)}); finished samples are kept. Run the same command again."
                    ) from error
                chunks.appendleft(chunk)
                continue
            for files in samples:
                store(folder, files)
                advance(1)


_maker: Maker | None = None


def _make(job: Job, indices: tuple[int, ...]) -> list[dict[str, bytes]]:
    """On a node: the files of some samples. The renderer is kept for the next task of the same job."""
    global _maker
    if _maker is None or not _same(_maker.job, job):
        if _maker is not None:
            _maker.close()
        _maker = Maker(job)
    return [_maker.make(index) for index in indices]


def _same(one: Job, other: Job) -> bool:
    plain = [
        (job.seed, job.split, job.tier, dict(job.options), job.photo, job.world, job.own.fingerprints())
        for job in (one, other)
    ]
    return plain[0] == plain[1] and one.fingerprint == other.fingerprint


def _first_line(error: Exception) -> str:
    lines = str(error).strip().splitlines()
    return lines[0] if lines else type(error).__name__
