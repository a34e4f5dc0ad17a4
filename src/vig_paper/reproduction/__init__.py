"""The paper's section 5 as one run: data, training, methods under both renderers, tables and figures."""

from vig_paper.reproduction.run import Step, duration, reproduce, steps_of
from vig_paper.reproduction.settings import (
    DATASETS,
    RENDERERS,
    SCALES,
    ReproductionSettings,
    RunFolder,
    read_json,
)
from vig_paper.reproduction.work import OCCLUSION_LIMITS, Run
from vig_train.record import Record, read_record

__all__ = [
    "DATASETS",
    "OCCLUSION_LIMITS",
    "RENDERERS",
    "SCALES",
    "Record",
    "ReproductionSettings",
    "Run",
    "RunFolder",
    "Step",
    "duration",
    "read_json",
    "read_record",
    "reproduce",
    "steps_of",
]
