"""Work shared out to processes."""

from __future__ import annotations

import functools
import math
import os

import pytest

from vig.errors import UserError
from vig.processes import map_in_processes

pytestmark = pytest.mark.slow


def test_results_come_in_order_of_the_items() -> None:
    items = [float(i) for i in range(40)]
    found = list(map_in_processes(functools.partial, math.sqrt, items, 2))
    assert found == [math.sqrt(item) for item in items]


def test_what_work_raises_is_raised_here() -> None:
    with pytest.raises(ValueError, match="math domain error"):
        list(map_in_processes(functools.partial, math.sqrt, [1.0, -1.0], 2))


def test_a_killed_worker_is_told_in_one_line() -> None:
    with pytest.raises(UserError, match="a worker process was killed"):
        list(map_in_processes(functools.partial, os._exit, [1], 1))


def test_a_consumer_that_stops_waits_for_no_more_items() -> None:
    found = map_in_processes(functools.partial, math.sqrt, iter([1.0] * 10**9), 2)
    assert next(found) == 1.0
    found.close()
