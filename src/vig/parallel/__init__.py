"""Work shared out to threads and to processes."""

from vig.parallel.processes import Lost as Lost
from vig.parallel.processes import check_main_module as check_main_module
from vig.parallel.processes import map_as_done as map_as_done
from vig.parallel.processes import map_in_processes as map_in_processes
from vig.parallel.processes import one_thread_in_children as one_thread_in_children
from vig.parallel.processes import without_interrupts as without_interrupts
from vig.parallel.threads import map_on_threads as map_on_threads
from vig.parallel.threads import on_one_core as on_one_core
from vig.parallel.threads import set_thread_count as set_thread_count
from vig.parallel.threads import thread_count as thread_count
from vig.parallel.threads import thread_limit as thread_limit
