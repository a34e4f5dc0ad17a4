"""Names that the command line offers. Nothing is imported here, so that `vig --help` stays quick."""

from __future__ import annotations

from typing import Literal, get_args

Split = Literal["train", "test", "validation"]
SPLITS: tuple[Split, ...] = get_args(Split)
"""In this order for good: a split's position is part of the seed of all that is made for it."""

LikelihoodName = Literal["robust", "gaussian", "spatial"]
OptimizerName = Literal["lm", "dogleg", "lbfgs", "bfgs", "cg", "gd"]
