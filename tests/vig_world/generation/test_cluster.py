"""The same job on a Ray cluster; skipped where Ray is not installed, but for the line that says so."""

import builtins
from pathlib import Path
from typing import Any

import pytest

from tests.nodes import needs_ray, turn_with_ray, two_nodes
from tests.vig_world.generation.test_kill import hashes
from vig.io.errors import UserError
from vig.scene import ObjectClass
from vig_world.generation.write import make_dataset

COUNT, SEED = 48, 12


def test_without_ray_the_remedy_is_told(tmp_path: Path, teapot: ObjectClass, monkeypatch) -> None:
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
    with turn_with_ray(), pytest.raises(UserError, match=f"no Ray cluster answers at '{address}'"):
        make_dataset(tmp_path / "out", 4, SEED, progress=False, object_class=teapot, ray=address)


@needs_ray
@pytest.mark.slow
def test_a_node_that_is_killed_loses_nothing(tmp_path: Path, teapot: ObjectClass) -> None:
    """Two nodes on this machine; one dies when a few samples are written."""
    out = tmp_path / "ray"
    partial = out / "train" / "partial"
    with two_nodes(lambda: len(list(partial.glob("*.json"))), after=8) as (address, killed):
        make_dataset(out, COUNT, SEED, progress=False, object_class=teapot, ray=address)
    assert 8 <= killed[0] < COUNT - 8  # in the middle
    here = make_dataset(tmp_path / "here", COUNT, SEED, workers=1, progress=False, object_class=teapot)
    assert hashes(out) == hashes(here)
