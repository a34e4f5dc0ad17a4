"""Work shared out to processes."""

from __future__ import annotations

import functools
import itertools
import math
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from vig.errors import UserError
from vig.parallel.processes import map_in_processes

pytestmark = pytest.mark.slow


def test_results_come_in_order_of_the_items() -> None:
    items = [float(i) for i in range(40)]
    found = list(map_in_processes(functools.partial, math.sqrt, items, 2))
    assert found == [math.sqrt(item) for item in items]


def test_what_work_raises_is_raised_here() -> None:
    with pytest.raises(ValueError, match="math domain error"):
        list(map_in_processes(functools.partial, math.sqrt, [1.0, -1.0], 2))


def test_a_killed_worker_is_told_in_one_line() -> None:
    with pytest.raises(UserError, match="one of 1 worker processes was killed"):
        list(map_in_processes(functools.partial, os._exit, [1], 1))


def test_a_consumer_that_stops_waits_for_no_more_items() -> None:
    found = map_in_processes(functools.partial, math.sqrt, itertools.repeat(1.0), 2)
    assert next(found) == 1.0
    found.close()


def test_what_preparing_raises_is_raised_here() -> None:
    with pytest.raises(ValueError, match="math domain error"):
        list(map_in_processes(math.sqrt, -1.0, [1.0], 1))


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
