"""Methods evaluated on datasets: the paper's metrics, its Table 1, and statistics."""

from vig_train.evaluation.metrics import (
    angle_error_deg,
    appearance_ab,
    appearance_error,
    illumination_error,
    illumination_relative,
    segmentation_iou,
    shape_error_mm,
    shape_paper,
    shape_ratio,
)
from vig_train.evaluation.presentation import blocks, markdown_table
from vig_train.evaluation.protocol import evaluate
from vig_train.evaluation.results import MethodResult, write_csv
from vig_train.evaluation.table import METRICS, OTHER_METRICS, build_table, save_table, summarise

__all__ = [
    "METRICS",
    "OTHER_METRICS",
    "MethodResult",
    "angle_error_deg",
    "appearance_ab",
    "appearance_error",
    "blocks",
    "build_table",
    "evaluate",
    "illumination_error",
    "illumination_relative",
    "markdown_table",
    "save_table",
    "segmentation_iou",
    "shape_error_mm",
    "shape_paper",
    "shape_ratio",
    "summarise",
    "write_csv",
]
