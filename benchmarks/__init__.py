"""Speed, measured: `python -m benchmarks.NAME --json FILE`."""

import os

# Read when numpy is imported, so it must be set before: one thread, unless the caller sets it.
os.environ.setdefault("OMP_NUM_THREADS", "1")
