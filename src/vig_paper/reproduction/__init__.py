"""The paper's section 5 as one run: data, training, methods under both renderers, tables and figures."""

from vig_paper.reproduction.run import Step, duration, reproduce, steps_of
from vig_paper.reproduction.settings import DATASETS, RENDERERS, SCALES, RunFolder, Settings, read_json
from vig_paper.reproduction.work import LIMITS, Run
from vig_train.record import Record, read_record

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
