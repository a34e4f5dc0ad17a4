"""From a first guess to an explanation: objective, optimisers, verdict."""

from vig.inference.annealing import Annealed
from vig.inference.bfgs import BFGS
from vig.inference.calibration import Calibration, calibration_of
from vig.inference.closed_form import Alternating, ClosedForm
from vig.inference.conjugate_gradient import ConjugateGradient
from vig.inference.dogleg import Dogleg
from vig.inference.explain import explain, explain_one
from vig.inference.explanation import Explanation, Verdict
from vig.inference.gradient_descent import GradientDescent
from vig.inference.lbfgs import LBFGS
from vig.inference.levenberg_marquardt import LevenbergMarquardt
from vig.inference.objective import Objective, Valuation
from vig.inference.optimizer import Budget, Descent, Optimizer, Problem
from vig.inference.posterior import geometry_of, objective_of
from vig.inference.prior import Belief
from vig.inference.settings import ExplainSettings, Stage
from vig.inference.starts import starts

__all__ = [
    "BFGS",
    "LBFGS",
    "Alternating",
    "Annealed",
    "Belief",
    "Budget",
    "Calibration",
    "ClosedForm",
    "ConjugateGradient",
    "Descent",
    "Dogleg",
    "ExplainSettings",
    "Explanation",
    "GradientDescent",
    "LevenbergMarquardt",
    "Objective",
    "Optimizer",
    "Problem",
    "Stage",
    "Valuation",
    "Verdict",
    "calibration_of",
    "explain",
    "explain_one",
    "geometry_of",
    "objective_of",
    "starts",
]
