"""From a first guess to an explanation: objective, optimisers, verdict."""

from vig.inference.calibration import Calibration, calibration_of
from vig.inference.explain import explain, explain_one
from vig.inference.fit import Fit, Verdict
from vig.inference.objective import Objective, Valuation
from vig.inference.posterior import geometry_of, objective_of
from vig.inference.prior import Belief
from vig.inference.settings import ExplainSettings, Stage
from vig.inference.starts import starts

__all__ = [
    "Belief",
    "Calibration",
    "ExplainSettings",
    "Fit",
    "Objective",
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
