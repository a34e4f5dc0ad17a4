import subprocess
import sys

PROGRAM = """
import threadpoolctl
import torch

from vig_world.threads import one_thread


def blas_threads():
    libraries = threadpoolctl.threadpool_info()
    return {library["num_threads"] for library in libraries if library["user_api"] == "blas"}


cores = torch.get_num_threads()
with threadpoolctl.threadpool_limits(2, user_api="blas"):
    before = blas_threads()
    with one_thread():
        with one_thread():
            assert (torch.get_num_threads(), blas_threads()) == (1, {1})
        assert (torch.get_num_threads(), blas_threads()) == (1, {1})
    assert (torch.get_num_threads(), blas_threads()) == (cores, before)
"""


def test_one_thread_is_of_torch_and_of_numpy_and_nests() -> None:
    """In a process of its own, in which no thread of another test computes."""
    subprocess.run([sys.executable, "-c", PROGRAM], check=True)
