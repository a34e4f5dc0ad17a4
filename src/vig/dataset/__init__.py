"""Samples on disk in the BOP layout: made, resumed, checked, read, looked at, exported."""

from vig.dataset.check import Findings, check_dataset
from vig.dataset.coco import export_coco
from vig.dataset.job import TIERS, Job, Renderer
from vig.dataset.read import Dataset, describe_split, read_dataset
from vig.dataset.show import contact_sheet, histograms
from vig.dataset.webdataset import export_webdataset
from vig.dataset.write import make_dataset

__all__ = [
    "TIERS",
    "Dataset",
    "Findings",
    "Job",
    "Renderer",
    "check_dataset",
    "contact_sheet",
    "describe_split",
    "export_coco",
    "export_webdataset",
    "histograms",
    "make_dataset",
    "read_dataset",
]
