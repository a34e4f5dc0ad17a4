"""The command line: imports the core and is imported by nothing in it."""

import os

# The matrices of verbs are small: numpy's further threads would only spin. It is read when numpy is loaded.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
