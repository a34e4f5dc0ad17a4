"""The paper's section 5 as one run: data, training, methods under both renderers, tables and figures."""

from vig_lab.reproduction.record import Record, read_record
from vig_lab.reproduction.run import Step, duration, reproduce, steps_of
from vig_lab.reproduction.settings import DATASETS, RENDERERS, SCALES, RunFolder, Settings, read_json
from vig_lab.reproduction.work import LIMITS, Run

__all__ = [
    "DATASETS",
    "LIMITS",
    "RENDERERS",
    "SCALES",
    "Record",
    "Run",
    "RunFolder",
    "Settings",
    "Step",
    "duration",
    "read_json",
    "read_record",
    "reproduce",
    "steps_of",
]
