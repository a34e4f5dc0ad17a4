"""What `vig doctor` says of speed: each line with what to do."""

from __future__ import annotations

import os
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest
import torch

from vig_app.cli import speed
from vig_app.cli.speed import (
    EXTRAS,
    Extra,
    extras,
    free_memory,
    load,
    memory,
    rows,
    threads,
)

ROOT = Path(__file__).parents[3]


@pytest.fixture
def two_threads() -> Iterator[None]:
    before = torch.get_num_threads()
    torch.set_num_threads(2)
    yield
    torch.set_num_threads(before)


def test_threads(two_threads: None, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("OMP_NUM_THREADS", "MKL_NUM_THREADS"):
        monkeypatch.delenv(name, raising=False)
    assert threads(2).do == ""
    assert threads(1).do.endswith("export OMP_NUM_THREADS=1") and "wait for each other" in threads(1).do
    assert "export OMP_NUM_THREADS=4" in threads(4).do and "--workers 4" in threads(4).do
    monkeypatch.setenv("OMP_NUM_THREADS", "2")
    assert "unset OMP_NUM_THREADS;" in threads(4).do and threads(4).state == "2 on 4 processors"


def test_load(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "getloadavg", lambda: (3.2, 0.0, 0.0))
    assert load(4).do == "" and "wait" in load(2).do and load(2).state.startswith("3.2 processes")


@pytest.mark.parametrize(
    ("free", "cpus", "said"),
    [(8 << 30, 2, ""), (1 << 30, 2, "no more than --workers 1: 0.8 GB each"), (1 << 28, 1, "may be killed")],
)
def test_memory(free: int, cpus: int, said: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(speed, "free_memory", lambda: free)
    assert said in memory(cpus).do and bool(said) == bool(memory(cpus).do)


def write(path: Path, text: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)


def test_free_memory_is_within_a_containers_limit(tmp_path: Path) -> None:
    assert free_memory(tmp_path) is None
    write(tmp_path / "proc/meminfo", "MemTotal: 9000 kB\nMemAvailable:    4000 kB\n")
    assert free_memory(tmp_path) == 4000 * 1024
    write(tmp_path / "sys/fs/cgroup/memory.max", "max\n")
    write(tmp_path / "sys/fs/cgroup/memory.current", "1000\n")
    assert free_memory(tmp_path) == 4000 * 1024
    write(tmp_path / "sys/fs/cgroup/memory.max", "3000\n")
    assert free_memory(tmp_path) == 2000
    write(tmp_path / "sys/fs/cgroup/memory.current", "5000\n")
    assert free_memory(tmp_path) == 0


def test_extras_are_those_of_the_project() -> None:
    optional = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    assert set(EXTRAS) == set(optional) - {"dev", "docs"}
    for name, extra in EXTRAS.items():
        assert len(extra.modules) == len(optional[name]), name


def test_a_missing_extra_is_a_line_with_what_it_brings() -> None:
    known = {"here": Extra(("json",), "texts"), "away": Extra(("json", "no_such_module"), "dreams")}
    found = extras(known)
    assert found["here"]["missing"] == [] and found["away"]["missing"] == ["no_such_module"]
    (_, here), (name, away) = rows([], found)
    assert here == "ok: texts" and name == "extra away"
    assert away == "without no_such_module no dreams; pip install 'vig[away]'"
