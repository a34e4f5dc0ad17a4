"""The same job on a Ray cluster; skipped where Ray is not installed, but for the line that says so."""

from __future__ import annotations

import builtins
import hashlib
import importlib.util
import threading
import time
from pathlib import Path
from typing import Any

import pytest

from vig.errors import UserError
from vig.scene import ObjectClass
from vig_world.generation.write import make_dataset

COUNT, SEED = 48, 12
needs_ray = pytest.mark.skipif(importlib.util.find_spec("ray") is None, reason="ray is not installed")


def hashes(root: Path) -> dict[str, str]:
    files = (path for path in root.rglob("*") if path.is_file())
    return {str(path.relative_to(root)): hashlib.sha256(path.read_bytes()).hexdigest() for path in files}


def test_without_ray_the_remedy_is_told(
    tmp_path: Path, teapot: ObjectClass, monkeypatch: pytest.MonkeyPatch
) -> None:
    load = builtins.__import__

    def no_ray(name: str, *rest: Any) -> Any:
        if name == "ray":
            raise ModuleNotFoundError(name=name)
        return load(name, *rest)

    monkeypatch.setattr(builtins, "__import__", no_ray)
    with pytest.raises(UserError, match=r"pip install 'vig\[cluster\]'"):
        make_dataset(tmp_path / "out", 4, SEED, progress=False, object_class=teapot, ray="auto")


@needs_ray
@pytest.mark.slow
@pytest.mark.parametrize("address", ["auto", "127.0.0.1:1", "ray://127.0.0.1:1", "nonsense"])
def test_where_there_is_no_cluster_it_is_told(address: str, tmp_path: Path, teapot: ObjectClass) -> None:
    with pytest.raises(UserError, match=f"no Ray cluster answers at '{address}'"):
        make_dataset(tmp_path / "out", 4, SEED, progress=False, object_class=teapot, ray=address)


@needs_ray
@pytest.mark.slow
def test_a_node_that_is_killed_loses_nothing(tmp_path: Path, teapot: ObjectClass) -> None:
    """Two nodes on this machine; one dies when a few samples are written."""
    import ray
    from ray.cluster_utils import Cluster

    cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 1, "include_dashboard": False})
    out, killed = tmp_path / "ray", []
    try:
        second = cluster.add_node(num_cpus=1)
        ray.init(address=cluster.address, log_to_driver=False)
        over = threading.Event()

        def kill() -> None:
            while not over.is_set():
                finished = len(list((out / "train" / "partial").glob("*.json")))
                if not killed and finished >= 8:
                    cluster.remove_node(second, allow_graceful=False)
                    killed.append(finished)
                time.sleep(0.01)

        thread = threading.Thread(target=kill)
        thread.start()
        try:
            address = cluster.address
            make_dataset(out, COUNT, SEED, progress=False, object_class=teapot, ray=address)
        finally:
            over.set()
            thread.join()
    finally:
        ray.shutdown()
        cluster.shutdown()
    assert 8 <= killed[0] < COUNT - 8  # in the middle
    here = make_dataset(tmp_path / "here", COUNT, SEED, workers=1, progress=False, object_class=teapot)
    assert hashes(out) == hashes(here)
