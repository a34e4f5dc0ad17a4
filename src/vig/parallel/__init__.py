"""Work shared out to threads and to processes."""

from vig.parallel.processes import (
    Lost,
    check_main_module,
    map_as_done,
    map_in_processes,
    one_thread_in_children,
    without_interrupts,
)
from vig.parallel.threads import map_on_threads, on_one_core, set_thread_count, thread_count, thread_limit

__all__ = [
    "Lost",
    "check_main_module",
    "map_as_done",
    "map_in_processes",
    "map_on_threads",
    "on_one_core",
    "one_thread_in_children",
    "set_thread_count",
    "thread_count",
    "thread_limit",
    "without_interrupts",
]
