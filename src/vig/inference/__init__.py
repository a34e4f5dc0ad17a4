"""From a first guess to an explanation: objective, optimisers, verdict."""

from vig.inference.conjugate_gradient import ConjugateGradient
from vig.inference.explain import explain, explain_one
from vig.inference.explanation import Explanation, Verdict
from vig.inference.levenberg_marquardt import LevenbergMarquardt
from vig.inference.objective import Objective, Valuation
from vig.inference.optimizer import Budget, Descent, Optimizer, Problem
from vig.inference.posterior import geometry_of, objective_of
from vig.inference.prior import Belief
from vig.inference.settings import ExplainSettings, Stage
from vig.inference.starts import starts

__all__ = [
    "Belief",
    "Budget",
    "ConjugateGradient",
    "Descent",
    "ExplainSettings",
    "Explanation",
    "LevenbergMarquardt",
    "Objective",
    "Optimizer",
    "Problem",
    "Stage",
    "Valuation",
    "Verdict",
    "explain",
    "explain_one",
    "geometry_of",
    "objective_of",
    "starts",
]
