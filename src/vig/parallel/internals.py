"""Private interfaces of libraries: each function documents its result when one is missing."""

from concurrent.futures import ProcessPoolExecutor
from multiprocessing.process import BaseProcess


def process_of(executor: ProcessPoolExecutor) -> BaseProcess | None:
    """Return the process of an executor that has one, for its exit code; None when unknown."""
    return next(iter((getattr(executor, "_processes", None) or {}).values()), None)
