"""Speed, measured: `python -m benchmarks.NAME --json FILE`."""

import os

# Read when numpy is imported, so it has to be said before: one thread, unless the caller says otherwise.
os.environ.setdefault("OMP_NUM_THREADS", "1")
