"""The search for the maximum of an objective: batched Levenberg-Marquardt, at falling noise."""

from vig.search.annealing import Annealed
from vig.search.levenberg_marquardt import LevenbergMarquardt
from vig.search.optimizer import Budget, Descent, Optimizer, Problem

__all__ = ["Annealed", "Budget", "Descent", "LevenbergMarquardt", "Optimizer", "Problem"]
