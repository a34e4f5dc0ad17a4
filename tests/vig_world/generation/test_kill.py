"""Kill -9 of workers and of whole runs: nothing finished is lost, and the bytes are those of a quiet run."""

from __future__ import annotations

import hashlib
import multiprocessing
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from vig.errors import UserError
from vig.scene import ObjectClass
from vig_world.generation import pool
from vig_world.generation.job import Job
from vig_world.generation.write import make_dataset

COUNT, SEED = 24, 3
RUN = (
    "import sys; from vig.dataset import make_dataset\n"
    f"if __name__ == '__main__': make_dataset(sys.argv[1], {COUNT}, {SEED}, workers=2, progress=False)"
)


def hashes(root: Path) -> dict[str, str]:
    files = (path for path in root.rglob("*") if path.is_file())
    return {str(path.relative_to(root)): hashlib.sha256(path.read_bytes()).hexdigest() for path in files}


def finished(root: Path) -> int:
    return len(list((root / "train" / "partial").glob("*.json")))


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory, teapot: ObjectClass) -> Path:
    out = tmp_path_factory.mktemp("kill") / "quiet"
    return make_dataset(out, COUNT, SEED, workers=1, progress=False, object_class=teapot)


@contextmanager
def meanwhile(work: Callable[[threading.Event], None]) -> Iterator[None]:
    """Something that goes on in a thread until the block ends."""
    over = threading.Event()
    thread = threading.Thread(target=work, args=(over,))
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()


@pytest.mark.slow
def test_a_run_killed_three_times_ends_in_the_same_bytes(undisturbed: Path, tmp_path: Path) -> None:
    """At random moments; once the parent alone, so that its workers find themselves orphans."""
    rng = np.random.default_rng(COUNT)
    out, kept = tmp_path / "killed", 0
    for moment, group in zip(np.sort(rng.integers(1, COUNT - 6, 3)), (True, False, True), strict=True):
        run = subprocess.Popen([sys.executable, "-c", RUN, str(out)], start_new_session=True)
        deadline = time.monotonic() + 60
        while finished(out) < moment and run.poll() is None and time.monotonic() < deadline:
            time.sleep(0.002)
        time.sleep(rng.uniform(0, 0.03))
        assert run.poll() is None, "it was over before it was killed"
        os.killpg(run.pid, signal.SIGKILL) if group else run.kill()
        run.wait()
        assert finished(out) >= max(kept, moment)
        kept = finished(out)
    subprocess.run([sys.executable, "-c", RUN, str(out)], check=True)
    assert hashes(out) == hashes(undisturbed)


@pytest.mark.slow
def test_ctrl_c_ends_in_one_line_and_leaves_only_whole_samples(undisturbed: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    settings = ["--out", str(out), "--count", str(COUNT), "--seed", str(SEED), "--workers", "2"]
    command = [sys.executable, "-c", "from vig.cli.main import main; main()", "dataset", "make", *settings]
    run = subprocess.Popen(command, start_new_session=True, stderr=subprocess.PIPE, text=True)
    while finished(out) < 4 and run.poll() is None:
        time.sleep(0.002)
    os.killpg(run.pid, signal.SIGINT)  # as a terminal does: to the workers, too
    _, error = run.communicate(timeout=60)
    assert run.returncode == 130
    assert error.splitlines()[-1] == "vig: interrupted; what is finished stays"
    assert "Traceback" not in error
    pictures = list((out / "train" / "000000").rglob("*"))
    assert not [path for path in pictures if path.name.startswith(".")]
    assert len([path for path in pictures if path.suffix == ".png"]) == 4 * finished(out) < 4 * COUNT
    subprocess.run(command, check=True, capture_output=True)
    assert hashes(out) == hashes(undisturbed)


@pytest.mark.slow
def test_a_worker_that_cannot_write_ends_the_run_in_one_line(tmp_path: Path, teapot: ObjectClass) -> None:
    (tmp_path / "000000").write_text("in the way")
    job = Job(SEED, "train", "raster", teapot)
    with pytest.raises(UserError, match="cannot write .*a part of the path is a file"):
        pool.make_in_processes(job, tmp_path, list(range(16)), 2, lambda count: None)
    assert not multiprocessing.active_children()


@pytest.mark.slow
def test_a_killed_worker_is_replaced_and_the_run_goes_on(
    undisturbed: Path, tmp_path: Path, teapot: ObjectClass
) -> None:
    out, killed = tmp_path / "out", []

    def kill_one(over: threading.Event) -> None:
        while not over.is_set() and not killed:
            if finished(out) >= 3 and (children := multiprocessing.active_children()):
                os.kill(children[0].pid or 0, signal.SIGKILL)
                killed.append(children[0].pid)
            time.sleep(0.002)

    with meanwhile(kill_one):
        make_dataset(out, COUNT, SEED, workers=2, progress=False, object_class=teapot)
    assert killed
    assert hashes(out) == hashes(undisturbed)


def test_a_sample_that_kills_its_workers_every_time_is_named(tmp_path: Path, teapot: ObjectClass) -> None:
    def kill_all(over: threading.Event) -> None:
        while not over.is_set():
            for child in multiprocessing.active_children():
                child.kill()
            time.sleep(0.01)

    expected = "sample 0: its worker process was killed 3 times.*fewer workers"
    with meanwhile(kill_all), pytest.raises(UserError, match=expected):
        job = Job(SEED, "train", "raster", teapot)
        pool.make_in_processes(job, tmp_path, list(range(8)), 1, lambda count: None)


@pytest.mark.slow
def test_workers_are_renewed_and_make_the_same(
    undisturbed: Path, tmp_path: Path, teapot: ObjectClass, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pool, "RENEWED_AFTER", 8)
    started, start = [], pool._Pool.start
    monkeypatch.setattr(pool._Pool, "start", lambda self: (started.append(1), start(self)))
    out = make_dataset(tmp_path / "out", COUNT, SEED, workers=2, progress=False, object_class=teapot)
    assert len(started) >= 3
    assert hashes(out) == hashes(undisturbed)
