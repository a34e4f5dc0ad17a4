"""Names that the command line offers. Nothing is imported here, so that `vig --help` stays quick."""

from typing import Literal

LikelihoodName = Literal["robust", "gaussian", "spatial"]
OptimizerName = Literal["lm", "dogleg", "lbfgs", "bfgs", "cg", "gd"]
