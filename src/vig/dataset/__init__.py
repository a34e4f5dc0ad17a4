"""Samples on disk in the BOP layout: made, resumed, checked, read, looked at, exported."""

from vig.dataset.coco import export_coco
from vig.dataset.read import Dataset, describe_split, read_dataset
from vig.dataset.webdataset import export_webdataset

__all__ = [
    "Dataset",
    "describe_split",
    "export_coco",
    "export_webdataset",
    "read_dataset",
]
