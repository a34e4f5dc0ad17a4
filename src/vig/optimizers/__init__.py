"""Maximisers of an objective, behind one protocol (`Optimizer`)."""

from vig.optimizers.annealing import Annealed
from vig.optimizers.conjugate_gradient import ConjugateGradient
from vig.optimizers.dogleg import Dogleg
from vig.optimizers.gradient_descent import GradientDescent
from vig.optimizers.levenberg_marquardt import LevenbergMarquardt
from vig.optimizers.optimizer import Budget, Descent, Optimizer, Problem
from vig.optimizers.quasi_newton import BFGS, LBFGS

__all__ = [
    "BFGS",
    "LBFGS",
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
