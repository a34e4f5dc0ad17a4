"""Names of a dataset's splits and worlds. Nothing is imported here, so that `vig --help` stays quick."""

from typing import Literal, get_args

Split = Literal["train", "test", "validation"]
SPLITS: tuple[Split, ...] = get_args(Split)
"""In this order for good: a split's position is part of the seed of all that is made for it."""

World = Literal["photo", "paper"]
WORLDS: tuple[World, ...] = get_args(World)
"""What scenes are like: as wide as photographs are; or as the paper's, of matt objects in pastel colours."""
