"""The search for the maximum of an objective: batched Levenberg-Marquardt, at falling noise."""

from vig.search.levenberg_marquardt import LevenbergMarquardt as LevenbergMarquardt
from vig.search.optimizer import Budget as Budget
from vig.search.optimizer import Descent as Descent
from vig.search.optimizer import Evaluation as Evaluation
from vig.search.optimizer import Optimizer as Optimizer
from vig.search.optimizer import Problem as Problem
