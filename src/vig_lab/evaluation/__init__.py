"""How good the explanations are: the paper's metrics and its table, statistics and figures."""

from vig.dataset.metrics import (
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
from vig_lab.evaluation.presentation import blocks, markdown_table
from vig_lab.evaluation.protocol import METHODS, evaluate
from vig_lab.evaluation.results import MethodResult, write_csv
from vig_lab.evaluation.summary import summarise
from vig_lab.evaluation.table import METRICS, OTHER_METRICS, build_table, save_table

__all__ = [
    "METHODS",
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
