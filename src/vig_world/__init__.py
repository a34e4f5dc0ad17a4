"""The generator: scenes, renderers and datasets on disk. Only names stand here, so that help is quick."""

from typing import Literal, get_args

Split = Literal["train", "test", "validation"]
SPLITS: tuple[Split, ...] = get_args(Split)
"""In this order for good: a split's position is part of the seed of all that is made for it."""

World = Literal["photo", "paper", "studio"]
WORLDS: tuple[World, ...] = get_args(World)
"""Kinds of scenes: as varied as photographs; the paper's, with matt objects in pastel colours; the studio's,
which are put together in layers, and on which classes are trained."""
