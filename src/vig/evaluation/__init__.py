"""How good the explanations are: the paper's metrics and its table."""

from vig.evaluation.metrics import (
    angle_error_deg,
    appearance_error,
    illumination_error,
    segmentation_iou,
    shape_error_mm,
    shape_ratio,
)
from vig.evaluation.protocol import METHODS, evaluate
from vig.evaluation.results import MethodResult, write_csv
from vig.evaluation.table import METRICS, build_table, markdown_table, rich_table, save_table

__all__ = [
    "METHODS",
    "METRICS",
    "MethodResult",
    "angle_error_deg",
    "appearance_error",
    "build_table",
    "evaluate",
    "illumination_error",
    "markdown_table",
    "rich_table",
    "save_table",
    "segmentation_iou",
    "shape_error_mm",
    "shape_ratio",
    "write_csv",
]
