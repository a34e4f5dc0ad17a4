"""Other maximisers behind the protocol of `vig.search.Optimizer`, to compare Levenberg-Marquardt with."""

from vig.search import LevenbergMarquardt, Optimizer
from vig_paper.optimizers.conjugate_gradient import ConjugateGradient
from vig_paper.optimizers.dogleg import Dogleg
from vig_paper.optimizers.gradient_descent import GradientDescent
from vig_paper.optimizers.quasi_newton import BFGS, LBFGS

OPTIMIZERS: dict[str, Optimizer] = {
    "lm": LevenbergMarquardt(),
    "dogleg": Dogleg(),
    "lbfgs": LBFGS(),
    "bfgs": BFGS(),
    "cg": ConjugateGradient(),
    "gd": GradientDescent(),
}
"""At their default settings."""

__all__ = ["BFGS", "LBFGS", "OPTIMIZERS", "ConjugateGradient", "Dogleg", "GradientDescent"]
