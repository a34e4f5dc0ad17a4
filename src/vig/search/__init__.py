"""The search for the maximum of an objective: batched Levenberg-Marquardt, at falling noise."""

from vig.search.levenberg_marquardt import LevenbergMarquardt
from vig.search.optimizer import Budget, Descent, Evaluation, Optimizer, Problem

__all__ = ["Budget", "Descent", "Evaluation", "LevenbergMarquardt", "Optimizer", "Problem"]
