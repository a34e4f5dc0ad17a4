"""Work shared out to processes."""

import functools
import itertools
import math
import multiprocessing
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from vig.io.errors import UserError
from vig.parallel import Lost, map_as_done, map_in_processes, processes

pytestmark = pytest.mark.slow


@pytest.mark.parametrize(
    ("prepare", "shared", "item"), [(functools.partial, math.sqrt, -1.0), (math.sqrt, -1.0, 1.0)]
)
def test_what_preparing_and_work_raise_is_raised_here(prepare: Callable, shared: object, item: float) -> None:
    with pytest.raises(ValueError, match="math domain error"):
        list(map_in_processes(prepare, shared, [item], 1))


def test_what_kills_its_worker_again_and_again_is_told_in_one_line() -> None:
    with pytest.raises(UserError, match="a worker process was killed 3 times at the same item"):
        list(map_in_processes(functools.partial, os._exit, [1], 1))


def root_or_end(folder: Path) -> Callable[[float], float]:
    """The square root; of 7 the process's end, always, and of 3 the first time."""

    def work(number: float) -> float:
        (folder / f"{number}").touch()
        if number == 7 or (number == 3 and not (folder / "3 was tried").exists()):
            (folder / f"{number:g} was tried").touch()
            os.kill(os.getpid(), signal.SIGKILL)
        return math.sqrt(number)

    return work


def test_items_of_a_process_that_dies_are_done_by_another(tmp_path: Path) -> None:
    items = [float(number) for number in range(20)]
    found = dict(map_as_done(root_or_end, tmp_path, items, 2))
    assert found.pop(7) == Lost(3)
    assert found == {number: math.sqrt(number) for number in range(20) if number != 7}


def test_large_items_and_results_pass_each_other_in_order() -> None:
    """Either is larger than what a pipe holds: were both sides to send first, none would receive."""
    items = [np.full(300_000, number) for number in range(12)]
    for number, found in enumerate(map_in_processes(functools.partial, np.negative, items, 2)):
        assert (found == -number).all() and found.shape == (300_000,)


def test_none_is_far_ahead_of_the_oldest() -> None:
    """The first item takes long: what is handed out meanwhile is bounded, and so are waiting results."""
    taken: list[int] = []

    def items() -> Iterator[float]:
        for number in range(200):
            taken.append(number)
            yield 1.5 if number == 0 else 0.0

    found = map_as_done(functools.partial, time.sleep, items(), 2)
    numbers = []
    for number, _ in found:
        if number == 0:
            break
        numbers.append(number)
    assert max(numbers) <= 2 * processes.WINDOW and len(taken) <= 2 * processes.WINDOW + 2
    found.close()


def test_processes_are_renewed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(processes, "RENEWED_AFTER", 4)
    ids = [pid for _, pid in map_as_done(process_id, None, range(10), 1)]
    assert [ids.count(pid) for pid in dict.fromkeys(ids)] == [4, 4, 2]


def process_id(shared: None) -> Callable[[int], int]:
    return lambda item: os.getpid()


def test_a_consumer_that_stops_waits_for_no_more_items() -> None:
    found = map_in_processes(functools.partial, math.sqrt, itertools.repeat(1.0), 2)
    assert next(found) == 1.0
    found.close()


SLEEPING = """
import functools, multiprocessing, time
from vig.parallel import map_in_processes
if __name__ == "__main__":
    found = map_in_processes(functools.partial, time.sleep, [0.0] + [60.0] * 9, 2)
    next(found)
    print(*[child.pid for child in multiprocessing.active_children()], flush=True)
    next(found)
"""


def alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


def test_workers_end_when_their_parent_is_killed(tmp_path: Path) -> None:
    script = tmp_path / "sleeping.py"
    script.write_text(SLEEPING)
    with subprocess.Popen([sys.executable, script], stdout=subprocess.PIPE, text=True) as parent:
        assert parent.stdout is not None
        workers = [int(pid) for pid in parent.stdout.readline().split()]
        assert len(workers) == 2 and all(map(alive, workers))
        parent.send_signal(signal.SIGKILL)
        parent.wait()
    deadline = time.monotonic() + 20
    while any(map(alive, workers)) and time.monotonic() < deadline:
        time.sleep(0.1)
    assert not any(map(alive, workers))


UNGUARDED = """
import operator, sys
from vig.parallel import map_in_processes
{before}
print(list(map_in_processes(operator.itemgetter, {shared}, ["ab"], 2)))
"""


@pytest.mark.parametrize(
    ("before", "shared", "from_file", "reason"),
    [
        ("", "0", True, "it asked for processes itself"),
        # More than a pipe holds, which a process that ends as it starts never reads.
        ("", "b'x' * 2**20", True, "it asked for processes itself"),
        ("if __name__ != '__main__': sys.exit(3)", "0", True, "it ended with exit code 3"),
        ("", "0", False, "'<stdin>' is no file"),
    ],
)
def test_programs_without_a_main_guard_are_told_so(
    before: str, shared: str, from_file: bool, reason: str, tmp_path: Path
) -> None:
    program, script = UNGUARDED.format(before=before, shared=shared), tmp_path / "program.py"
    script.write_text(program)
    command = [sys.executable, str(script) if from_file else "-"]
    done = subprocess.run(command, input=program, capture_output=True, text=True, timeout=60)
    last = done.stderr.splitlines()[-1]
    assert done.returncode == 1 and reason in last and "if __name__ == '__main__':" in last
    assert done.stderr.count("Traceback") == 1 and done.stdout == ""  # the parent's alone


def test_what_processes_cannot_read_is_raised_here() -> None:
    """A class that only this process has cannot be unpickled in another."""
    with pytest.raises(AttributeError, match="Gone"):
        list(map_in_processes(functools.partial, Gone, [1], 1))


class Gone:
    """Absent where this module is imported anew."""


if multiprocessing.parent_process() is not None:
    del Gone
