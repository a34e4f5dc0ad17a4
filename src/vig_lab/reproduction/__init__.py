"""The paper's section 5 as one run: data, training, methods on both tiers, tables, figures, ablations."""

from vig_lab.reproduction.comparison import comparison_block
from vig_lab.reproduction.folder import DATASETS, TIERS, RunFolder, read_json
from vig_lab.reproduction.record import Record, read_record
from vig_lab.reproduction.run import duration, reproduce
from vig_lab.reproduction.scales import SCALES, Settings
from vig_lab.reproduction.stages import LIMITS, Run
from vig_lab.reproduction.steps import STAGES, Step, steps_of

__all__ = [
    "DATASETS",
    "LIMITS",
    "SCALES",
    "STAGES",
    "TIERS",
    "Record",
    "Run",
    "RunFolder",
    "Settings",
    "Step",
    "comparison_block",
    "duration",
    "read_json",
    "read_record",
    "reproduce",
    "steps_of",
]
