"""Samples on disk in the BOP layout: their format, and how they are read."""

from vig_world.dataset.read import Dataset as Dataset
from vig_world.dataset.read import read_dataset as read_dataset
