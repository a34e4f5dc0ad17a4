"""A Ray cluster of two nodes on this machine, one of which is killed on the way.

`auto` finds any cluster of this machine, and a process that is connected to a cluster dies with it: tests
that run in several processes must take turns.
"""

import fcntl
import importlib.util
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

needs_ray = pytest.mark.skipif(importlib.util.find_spec("ray") is None, reason="ray is not installed")


@contextmanager
def turn_with_ray() -> Iterator[None]:
    """Wait until no other process of this machine is in this block."""
    with open(Path(tempfile.gettempdir()) / "vig-tests-ray.lock", "w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)  # released when the file is closed, also by the death of the process
        yield


@contextmanager
def two_nodes(finished: Callable[[], int], after: int) -> Iterator[tuple[str, list[int]]]:
    """Start two nodes of one CPU each; kill the second one once `finished()` has reached `after`.

    Yields:
        The cluster's address, and a list that receives what `finished()` was when the node was killed.
    """
    import ray
    from ray.cluster_utils import Cluster

    with turn_with_ray():
        cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 1, "include_dashboard": False})
        killed: list[int] = []
        over = threading.Event()
        try:
            second = cluster.add_node(num_cpus=1)
            ray.init(address=cluster.address, log_to_driver=False)

            def kill() -> None:
                while not over.is_set() and not killed:
                    if (count := finished()) >= after:
                        cluster.remove_node(second, allow_graceful=False)
                        killed.append(count)
                    time.sleep(0.01)

            thread = threading.Thread(target=kill)
            thread.start()
            try:
                yield cluster.address, killed
            finally:
                over.set()
                thread.join()
        finally:
            ray.shutdown()
            cluster.shutdown()
