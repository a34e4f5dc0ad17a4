"""Runs over many photos, or the frames of a video."""

from vig_app.runs.ledger import LEDGER as LEDGER
from vig_app.runs.ledger import ledger_of as ledger_of
from vig_app.runs.photos import run as run
from vig_app.runs.work import PARTIAL as PARTIAL
from vig_app.runs.work import Rows as Rows
from vig_app.runs.work import RunSettings as RunSettings
from vig_app.runs.work import Task as Task
from vig_app.runs.work import row_of as row_of
