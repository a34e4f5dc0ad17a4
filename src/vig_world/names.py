"""Names of a dataset's splits. Nothing is imported here, so that `vig --help` stays quick."""

from typing import Literal, get_args

Split = Literal["train", "test", "validation"]
SPLITS: tuple[Split, ...] = get_args(Split)
"""In this order for good: a split's position is part of the seed of all that is made for it."""
