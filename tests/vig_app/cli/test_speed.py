"""What `vig doctor` says of speed: each line with what to do."""

import os
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest
import torch

from vig_app.cli import speed
from vig_app.cli.speed import EXTRAS, Extra, extras, load, memory, memory_of, rows, threads

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
    ("total", "free", "cpus", "said"),
    [
        (9 << 30, 8 << 30, 2, ""),
        (4 << 30, 1 << 30, 4, "no more than --workers 2: 0.5 GB each"),
        (1 << 30, 1 << 28, 1, "free some, or fits may be killed"),
        (1 << 28, 1 << 27, 4, "too small for a fit, which may be killed: 0.5 GB each; add swap"),
    ],
)
def test_memory(total: int, free: int, cpus: int, said: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(speed, "memory_of", lambda: (total, free))
    assert said in memory(cpus).do and bool(said) == bool(memory(cpus).do)
    assert f"of {total / 1e9:.1f} GB free" in memory(cpus).state


def test_memory_that_the_system_does_not_state_is_no_warning(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(speed, "memory_of", lambda: None)
    assert memory(2).state == "unknown on this system" and memory(2).do == ""


def write(path: Path, text: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)


def test_memory_is_within_a_containers_limit(tmp_path: Path) -> None:
    assert memory_of(tmp_path) is None
    write(tmp_path / "proc/meminfo", "MemTotal: 9000 kB\nMemAvailable:    4000 kB\n")
    assert memory_of(tmp_path) == (9000 * 1024, 4000 * 1024)
    write(tmp_path / "sys/fs/cgroup/memory.max", "max\n")
    write(tmp_path / "sys/fs/cgroup/memory.current", "1000\n")
    assert memory_of(tmp_path) == (9000 * 1024, 4000 * 1024)
    write(tmp_path / "sys/fs/cgroup/memory.max", "3000\n")
    assert memory_of(tmp_path) == (3000, 2000)
    write(tmp_path / "sys/fs/cgroup/memory.current", "5000\n")
    assert memory_of(tmp_path) == (3000, 0)


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
