"""Maximisers of an objective, behind one protocol (`Optimizer`)."""

from vig.names import OptimizerName
from vig.optimizers.annealing import Annealed
from vig.optimizers.conjugate_gradient import ConjugateGradient
from vig.optimizers.dogleg import Dogleg
from vig.optimizers.gradient_descent import GradientDescent
from vig.optimizers.levenberg_marquardt import LevenbergMarquardt
from vig.optimizers.optimizer import Budget, Descent, Optimizer, Problem
from vig.optimizers.quasi_newton import BFGS, LBFGS

OPTIMIZERS: dict[OptimizerName, Optimizer] = {
    "lm": LevenbergMarquardt(),
    "dogleg": Dogleg(),
    "lbfgs": LBFGS(),
    "bfgs": BFGS(),
    "cg": ConjugateGradient(),
    "gd": GradientDescent(),
}
"""The searches of a fit by name, at their default settings."""

__all__ = [
    "BFGS",
    "LBFGS",
    "OPTIMIZERS",
    "Annealed",
    "Budget",
    "ConjugateGradient",
    "Descent",
    "Dogleg",
    "GradientDescent",
    "LevenbergMarquardt",
    "Optimizer",
    "Problem",
]
