from __future__ import annotations

import threading

import pytest
import torch

from vig.render import map_on_threads, run_on_threads, small_matrices, thread_count


@pytest.fixture
def three_threads():
    before = torch.get_num_threads()
    torch.set_num_threads(3)
    yield
    torch.set_num_threads(before)


def test_work_is_shared_out_to_as_many_threads_as_torch_has(three_threads) -> None:
    met = threading.Barrier(3, timeout=10)
    seen: list[tuple[int, int]] = []

    def work(index: int) -> None:
        met.wait()  # passes only when three are here at once
        seen.append((index, thread_count()))

    run_on_threads(work, thread_count())
    assert sorted(seen) == [(0, 1), (1, 1), (2, 1)]
    assert torch.get_num_threads() == 3


def test_shared_out_work_that_shares_out_stays_on_its_thread(three_threads) -> None:
    """Else three threads would wait for each other's places in one pool."""

    def outer(item: int) -> int:
        return sum(map_on_threads(lambda inner: item * inner, range(5)))

    assert list(map_on_threads(outer, range(6))) == [10 * item for item in range(6)]


def test_within_small_matrices_torch_has_one_thread_and_work_all(three_threads) -> None:
    with small_matrices():
        assert torch.get_num_threads() == 1 and thread_count() == 3
        with small_matrices():
            assert thread_count() == 3
        assert torch.get_num_threads() == 1
    assert torch.get_num_threads() == 3 and thread_count() == 3


def test_an_error_in_a_thread_is_the_callers(three_threads) -> None:
    def work(index: int) -> None:
        if index == 1:
            raise ValueError("one of three")

    with pytest.raises(ValueError, match="one of three"):
        run_on_threads(work, 3)
    assert torch.get_num_threads() == 3
