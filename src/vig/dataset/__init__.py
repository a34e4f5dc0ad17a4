"""Samples on disk: making, resuming, reading and looking at datasets in the BOP layout."""

from vig.dataset.read import Dataset, read_dataset
from vig.dataset.show import contact_sheet
from vig.dataset.write import TIERS, make_dataset

__all__ = ["TIERS", "Dataset", "contact_sheet", "make_dataset", "read_dataset"]
