"""The command line: imports the core and is imported by nothing in it."""

import gc
import os

# The matrices of verbs are small: numpy's further threads would only spin. It is read when numpy is loaded.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
# While modules are loaded little becomes garbage, and looking for it takes a twentieth of a short command.
gc.set_threshold(20_000, 20, 50)
