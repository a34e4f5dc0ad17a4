"""Samples on disk in the BOP layout: their format, and how they are read."""

from vig_world.dataset.read import Dataset, read_dataset

__all__ = ["Dataset", "read_dataset"]
