import math
import os
import subprocess
import sys
import threading
from typing import Any

import pytest
import torch

from vig.io.errors import UserError
from vig.parallel.threads import map_on_threads, on_one_core, set_thread_count, thread_count


@pytest.fixture
def three_threads():
    before = torch.get_num_threads()
    torch.set_num_threads(3)
    yield
    torch.set_num_threads(before)


def test_work_is_shared_out_to_as_many_threads_as_torch_has(three_threads) -> None:
    met = threading.Barrier(3, timeout=10)

    def work(index: int) -> tuple[int, int]:
        met.wait()  # passes only when three are here at once
        return index, thread_count()

    assert list(map_on_threads(work, range(3))) == [(0, 1), (1, 1), (2, 1)]
    assert torch.get_num_threads() == 3


def test_shared_out_work_that_shares_out_stays_on_its_thread(three_threads) -> None:
    """Else three threads would wait for each other's places in one pool."""

    def outer(item: int) -> int:
        return sum(map_on_threads(lambda inner: item * inner, range(5)))

    assert list(map_on_threads(outer, range(6))) == [10 * item for item in range(6)]


def test_the_setting_of_other_threads_is_left_alone(three_threads) -> None:
    seen, ready = [], threading.Barrier(5, timeout=10)

    def use() -> None:
        torch.get_num_threads()  # from here on this thread has a setting of its own
        ready.wait()
        list(map_on_threads(str, range(2)))
        seen.append((torch.get_num_threads(), on_one_core(thread_count)))

    users = [threading.Thread(target=use) for _ in range(5)]
    for user in users:
        user.start()
    for user in users:
        user.join()
    assert seen == [(3, 3)] * 5
    assert torch.get_num_threads() == 3


def test_a_suspended_map_changes_nothing_for_its_consumer(three_threads) -> None:
    results = map_on_threads(lambda item: torch.get_num_threads(), range(6))
    assert next(results) == 1
    assert torch.get_num_threads() == 3 and thread_count() == 3
    results.close()


def test_an_error_in_a_thread_is_the_callers(three_threads) -> None:
    def work(index: int) -> None:
        if index == 1:
            raise ValueError("one of three")

    with pytest.raises(ValueError, match="one of three"):
        list(map_on_threads(work, range(3)))
    assert torch.get_num_threads() == 3


TOLD = """
from vig.parallel import on_one_core, set_thread_count, thread_count
set_thread_count(1)
import torch
assert (thread_count(), torch.get_num_threads()) == (1, 1)
torch.set_num_threads(3)
assert thread_count() == 3
from threadpoolctl import threadpool_info
threads = [each["num_threads"] for each in on_one_core(threadpool_info) if each["user_api"] == "blas"]
assert set(threads) == {1}, threads
"""


def test_a_number_that_is_set_before_torch_is_loaded_is_torchs_too() -> None:
    environment = {name: value for name, value in os.environ.items() if name != "OMP_NUM_THREADS"}
    subprocess.run([sys.executable, "-c", TOLD], env=environment, check=True)


@pytest.mark.parametrize("count", [0, 1.5, math.nan, "two", None])
def test_threads_are_counted_in_whole_numbers(count: Any) -> None:
    with pytest.raises(UserError, match=f"expected one thread or more; got {count}"):
        set_thread_count(count)
