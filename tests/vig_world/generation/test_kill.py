"""Kill -9 of workers and of whole runs: nothing finished is lost, and the bytes are those of a quiet run.

Runs that are killed hold still half way through a sample's files until they are told to go on, so no test
depends on how fast the machine is. Where a run must get somewhere first, it has `PATIENCE` seconds; a test
that gives up says how far it got and that the machine was too slow: that is not lost data.
"""

import hashlib
import multiprocessing
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest

from vig.io.errors import UserError
from vig.io.progress import Meter
from vig.parallel import processes
from vig.scene import ObjectClass
from vig_world.generation import pool
from vig_world.generation.files import sidecar_path
from vig_world.generation.job import Job
from vig_world.generation.write import make_dataset

COUNT, SEED, HELD = 6, 3, 2
"""Samples, their seed, and the first of them that a held run does not finish."""
PATIENCE = 120.0
"""Seconds that a run has to get where a test waits for it: twenty times what it takes on an idle core."""

# Workers run the top level of this script as well, as `spawn` has it, so that they hold still, too.
HELD_RUN = f"""
import os, signal, sys, time
from pathlib import Path
from vig_app.cli.main import main
from vig.parallel import processes
from vig_world.generation import job

write_picture, go, process = job.write_picture, Path(sys.argv[-1] + ".go"), os.getpid()

def held(path, data):
    if path.parent.name == "mask" and int(path.stem[:6]) >= {HELD}:
        half = path.parent / f".{{process:012x}}.png"
        half.parent.mkdir(parents=True, exist_ok=True)
        for begun in (half, path):
            begun.write_bytes(data[: len(data) // 2])
        while not go.exists():
            time.sleep(0.01)
        half.unlink(missing_ok=True)
        time.sleep(0.5)  # so that what happens as it goes on happens before the run is over
    write_picture(path, data)

job.write_picture, processes.AHEAD = held, int(os.environ["CHUNK"])
if __name__ == "__main__":
    settings = ["--count", "{COUNT}", "--seed", "{SEED}", "--workers", "2", "--out", sys.argv[1]]
    sys.argv[1:] = ["dataset", "make", *settings]
    main()
"""


@pytest.fixture(scope="module")
def teapot(packaged: ObjectClass) -> ObjectClass:
    """The class of datasets that the command line makes."""
    return packaged


def hashes(root: Path) -> dict[str, str]:
    files = (path for path in root.rglob("*") if path.is_file())
    return {str(path.relative_to(root)): hashlib.sha256(path.read_bytes()).hexdigest() for path in files}


def finished(root: Path) -> list[int]:
    return [index for index in range(COUNT) if sidecar_path(root / "train", index).is_file()]


def halves(root: Path) -> list[Path]:
    """Half-written files: one for each worker that is held. Temporary files have random names instead."""
    return list((root / "train" / "000000" / "mask").glob(".000000*"))


def wait_for(condition: Callable[[], bool], what: str, out: Path, run: subprocess.Popen[str]) -> None:
    """Wait until a condition holds. Fails when the run is over before, or after `PATIENCE` seconds."""
    deadline = time.monotonic() + PATIENCE
    while not condition():
        ended = run.poll()
        if ended is not None and not condition():
            pytest.fail(f"the run was over (exit code {ended}) before {what}; finished: {finished(out)}")
        if time.monotonic() > deadline:
            pytest.fail(
                f"machine too slow, no data lost: {PATIENCE:.0f} s, not yet {what}; finished: {finished(out)}"
            )
        time.sleep(0.01)


@contextmanager
def held_run(out: Path, chunk: int) -> Iterator[subprocess.Popen[str]]:
    """A run of two workers, given `chunk` samples at a time, that finishes samples before `HELD` only.

    It goes on when the file `out`.go appears. Nothing of it is left after the block.
    """
    script = out.with_suffix(".py")
    script.write_text(HELD_RUN)
    run = subprocess.Popen(
        [sys.executable, str(script), str(out)],
        env=os.environ | {"CHUNK": str(chunk)},
        start_new_session=True,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        yield run
    finally:
        with suppress(ProcessLookupError):
            os.killpg(run.pid, signal.SIGKILL)
        run.communicate()


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory, teapot: ObjectClass) -> dict[str, str]:
    """The hashes of a quiet run."""
    out = tmp_path_factory.mktemp("kill") / "quiet"
    return hashes(make_dataset(out, COUNT, SEED, workers=1, progress=False, object_class=teapot))


@pytest.fixture
def quick_workers(monkeypatch: pytest.MonkeyPatch) -> None:
    """Workers forked from a server that has imported everything, once a session, in place of `spawn`."""
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(["vig_world.generation.pool"])
    monkeypatch.setattr(pool.multiprocessing, "get_context", lambda method: context)


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


def go_on(out: Path, teapot: ObjectClass, expected: dict[str, str]) -> None:
    """Complete a run: finished samples stay as they are, the rest is made, the bytes are as expected."""
    kept = {path: path.stat().st_mtime_ns for i in finished(out) for path in out.rglob(f"{i:06d}*.png")}
    assert len(kept) == 4 * len(finished(out)), "DATA LOST: a finished sample lacks pictures"
    make_dataset(out, COUNT, SEED, workers=1, progress=False, object_class=teapot)
    again = [path.name for path, time_ns in kept.items() if path.stat().st_mtime_ns != time_ns]
    assert not again, "finished samples were made again"
    assert hashes(out) == expected, "DATA LOST OR CHANGED: not the bytes of a quiet run"


@pytest.mark.slow
def test_a_run_killed_half_way_through_samples_ends_in_the_same_bytes(
    undisturbed: dict[str, str], tmp_path: Path, teapot: ObjectClass
) -> None:
    """First the parent alone, so that its workers find themselves orphans, then they."""
    out = tmp_path / "killed"
    with held_run(out, chunk=1) as run:
        wait_for(lambda: len(halves(out)) == 2, "both workers were half way through a sample", out, run)
        assert finished(out) == [0, 1]
        run.kill()
        run.wait()
        assert len(halves(out)) == 2
        os.killpg(run.pid, signal.SIGKILL)
    assert finished(out) == [0, 1], "DATA LOST: kill -9 took a finished sample"
    go_on(out, teapot, undisturbed)


@pytest.mark.slow
def test_ctrl_c_ends_in_one_line_and_leaves_only_whole_samples(
    undisturbed: dict[str, str], tmp_path: Path, teapot: ObjectClass
) -> None:
    """A worker finishes the sample in progress; here one worker has all samples."""
    out = tmp_path / "out"
    with held_run(out, chunk=COUNT) as run:
        wait_for(lambda: len(halves(out)) == 1, "the worker was half way through a sample", out, run)
        os.killpg(run.pid, signal.SIGINT)  # as a terminal does: to the workers, too
        out.with_name(f"{out.name}.go").touch()
        _, error = run.communicate(timeout=PATIENCE)
    assert run.returncode == 130
    assert error.splitlines()[-1] == "vig: interrupted; what is finished stays"
    assert "Traceback" not in error
    assert HELD in finished(out) and len(finished(out)) < COUNT
    pictures = list((out / "train" / "000000").rglob("*.png"))
    assert not [path for path in pictures if path.name.startswith(".")]
    assert len(pictures) == 4 * len(finished(out))
    go_on(out, teapot, undisturbed)


@pytest.mark.usefixtures("quick_workers")
def test_a_worker_that_cannot_write_ends_the_run_in_one_line(tmp_path: Path, teapot: ObjectClass) -> None:
    (tmp_path / "000000").write_text("in the way")
    job = Job(SEED, "train", "raster", teapot)
    with pytest.raises(UserError, match="cannot write .*a part of the path is a file"):
        pool.make_samples(job, tmp_path, list(range(16)), 2, lambda count: None)
    assert not multiprocessing.active_children()


@pytest.mark.usefixtures("quick_workers")
def test_killed_and_renewed_workers_are_replaced_and_the_run_goes_on(
    undisturbed: dict[str, str], tmp_path: Path, teapot: ObjectClass, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The second sample's worker is killed as soon as the sample is there, and each makes two at most."""
    monkeypatch.setattr(processes, "AHEAD", 1)
    monkeypatch.setattr(processes, "RENEWED_AFTER", 2)
    started, start, advance = [], processes._WorkerProcess.__init__, Meter.advance

    def counted(self: processes._WorkerProcess, *given: object) -> None:
        start(self, *given)
        started.append(self.process)

    def killing(self: Meter, count: int) -> None:
        advance(self, count)
        if self.done == 2:
            started[0].kill()
            killed.append(started[0])

    killed: list[object] = []
    monkeypatch.setattr(processes._WorkerProcess, "__init__", counted)
    monkeypatch.setattr(Meter, "advance", killing)
    out = make_dataset(tmp_path / "out", COUNT, SEED, workers=2, progress=False, object_class=teapot)
    assert killed
    assert len(started) >= 3
    assert hashes(out) == undisturbed


def test_a_sample_that_kills_its_workers_every_time_is_named(tmp_path: Path, teapot: ObjectClass) -> None:
    def kill_all(over: threading.Event) -> None:
        while not over.is_set():
            for child in multiprocessing.active_children():
                child.kill()
            time.sleep(0.01)

    expected = "16 failed and 0 were made.*sample [0-7]: its worker process was killed 3 times.*fewer workers"
    with meanwhile(kill_all), pytest.raises(UserError, match=expected):
        job = Job(SEED, "train", "raster", teapot)
        pool.make_samples(job, tmp_path, list(range(8)), 2, lambda count: None)
