import threadpoolctl
import torch

from vig.parallel import threads
from vig_world.threads import one_thread


def blas_threads() -> set[int]:
    return {
        library["num_threads"] for library in threadpoolctl.threadpool_info() if library["user_api"] == "blas"
    }


def test_one_thread_is_of_torch_and_of_numpy_and_nests() -> None:
    threads.linear_algebra.cache_clear()  # tests before this one may have loaded further libraries
    cores = torch.get_num_threads()
    with threadpoolctl.threadpool_limits(2, user_api="blas"):
        before = blas_threads()
        with one_thread():
            with one_thread():
                assert (torch.get_num_threads(), blas_threads()) == (1, {1})
            assert (torch.get_num_threads(), blas_threads()) == (1, {1})
        assert (torch.get_num_threads(), blas_threads()) == (cores, before)
