"""Methods evaluated on datasets: the paper's metrics, its Table 1, and statistics."""

from vig_train.evaluation.presentation import blocks, markdown_table
from vig_train.evaluation.protocol import evaluate
from vig_train.evaluation.results import MethodResult, write_csv
from vig_train.evaluation.table import METRICS, build_table, save_table, summarise

__all__ = [
    "METRICS",
    "MethodResult",
    "blocks",
    "build_table",
    "evaluate",
    "markdown_table",
    "save_table",
    "summarise",
    "write_csv",
]
