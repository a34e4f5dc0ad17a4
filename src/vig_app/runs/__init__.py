"""Runs over many photos, or the frames of a video."""

from vig_app.runs.ledger import LEDGER, ledger_of
from vig_app.runs.photos import run
from vig_app.runs.work import PARTIAL, Rows, RunSettings, Task, row_of

__all__ = ["LEDGER", "PARTIAL", "Rows", "RunSettings", "Task", "ledger_of", "row_of", "run"]
