"""The work of `processes` on a Ray cluster (the extra `cluster`): nodes compute, this process hands out."""

import logging
import socket
import uuid
from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator
from itertools import islice
from typing import Any, TypeVar

from vig.io.errors import UserError
from vig.parallel.processes import Lost

Given = TypeVar("Given")
Result = TypeVar("Result")


def map_on_cluster(
    prepare: Callable[[Any], Callable[[Given], Result]],
    shared: Any,
    items: Iterable[Given],
    address: str,
    chunk: int = 1,
) -> Iterator[tuple[int, Result | Lost]]:
    """Yield number and work(item) of items as they are done, work being `prepare(shared)` in each process.

    The nodes need vig installed, but no shared disk. A task whose worker or node dies is done elsewhere.

    Args:
        prepare: A function of a module.
        shared: Its argument.
        items: Taken as they are needed.
        address: Address of the cluster, `auto` for the one that this machine belongs to.
        chunk: Items of a task.

    Raises:
        UserError: Ray is not installed, there is no cluster, or work raised one.
        RuntimeError: Work raised anything else.
    """
    require_ray()
    import ray

    ours = not ray.is_initialized()
    if ours:
        _check_answers(address)
        try:
            ray.init(address=address, log_to_driver=False, logging_level=logging.ERROR)
        except (ConnectionError, ValueError, RuntimeError) as error:
            raise _no_cluster(address, error) from error
    try:
        yield from _run(ray, prepare, ray.put(shared), iter(enumerate(items)), chunk)
    finally:
        if ours:
            ray.shutdown()


def require_ray() -> None:
    """Raise UserError when Ray is not installed."""
    try:
        import ray  # noqa: F401
    except ImportError as error:
        raise UserError("this needs ray; run pip install 'vig[cluster]'.") from error


def _check_answers(address: str) -> None:
    """Refuse an address where nothing listens within seconds; Ray itself takes minutes."""
    host, _, port = address.removeprefix("ray://").rpartition(":")
    if host and port.isdigit():
        try:
            socket.create_connection((host, int(port)), timeout=5.0).close()
        except (OSError, OverflowError) as error:
            raise _no_cluster(address, error) from error


def _no_cluster(address: str, error: Exception) -> UserError:
    return UserError(
        f"no Ray cluster answers at '{address}' ({_first_line(error)}); start one with"
        " `ray start --head`, or leave the cluster out."
    )


def _run(
    ray: Any, prepare: Any, shared: Any, items: Iterator[tuple[int, Any]], size: int
) -> Iterator[tuple[int, Any]]:
    # Times that Ray retries a task whose worker or node has died, and this process a task that Ray gave up.
    retries = 5
    # 500: tasks after which a worker process is replaced
    do = ray.remote(num_cpus=1, max_retries=retries, max_calls=500)(_do)
    token, again = uuid.uuid4().hex, deque[list[tuple[int, Any]]]()
    running: dict[Any, list[tuple[int, Any]]] = {}
    losses: Counter[int] = Counter()
    while True:
        # 2: tasks in progress or queued for each processor of the cluster
        limit = 2 * max(1, int(ray.cluster_resources().get("CPU", 1)))
        while len(running) < limit and (chunk := again.popleft() if again else list(islice(items, size))):
            running[do.remote(token, prepare, shared, [item for _, item in chunk])] = chunk
        if not running:
            return
        for done in ray.wait(list(running), timeout=1.0)[0]:
            chunk = running.pop(done)
            try:
                results = ray.get(done)
            except ray.exceptions.RayTaskError as error:
                raise _worker_error(error) from error
            except ray.exceptions.RayError:  # worker, node or result lost
                losses[chunk[0][0]] += 1
                if losses[chunk[0][0]] <= retries:
                    again.append(chunk)
                else:
                    yield from ((number, Lost(retries)) for number, _ in chunk)
                continue
            yield from zip((number for number, _ in chunk), results, strict=True)


def _worker_error(error: Any) -> Exception:
    if isinstance(error.cause, UserError):
        return UserError(str(error.cause))
    if isinstance(error.cause, ModuleNotFoundError):
        return UserError(
            f"a node of the cluster lacks a package ({_first_line(error.cause)}); install vig on every node."
        )
    return RuntimeError(str(error))


_work: tuple[str, Callable[[Any], Any]] | None = None


def _do(token: str, prepare: Any, shared: Any, items: list[Any]) -> list[Any]:
    """Return the results of some items on a node. The work is kept for the next task of the same run."""
    global _work
    if _work is None or _work[0] != token:
        _work = token, prepare(shared)
    return [_work[1](item) for item in items]


def _first_line(error: Exception) -> str:
    lines = str(error).strip().splitlines()
    return lines[0] if lines else type(error).__name__
