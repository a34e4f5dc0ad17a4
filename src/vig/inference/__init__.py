"""Fits from predictions: objective, starts, refinement, selection, confidence."""

from vig.inference.calibration import CONFIDENCE_FEATURES, FitCalibration, calibration_of
from vig.inference.explain import explain, explain_one
from vig.inference.families import family_of
from vig.inference.hints import PixelLabel, ReprojectionTerm, WindowHints
from vig.inference.objective import Objective, RecognitionPrior
from vig.inference.posterior import geometry_of, objective_of
from vig.inference.refinement import ExpectedStart, starts
from vig.inference.settings import ExplainSettings, Fit, OtherView, Stage, Verdict, resolve, without_network

__all__ = [
    "CONFIDENCE_FEATURES",
    "ExpectedStart",
    "ExplainSettings",
    "Fit",
    "FitCalibration",
    "Objective",
    "OtherView",
    "PixelLabel",
    "RecognitionPrior",
    "ReprojectionTerm",
    "Stage",
    "Verdict",
    "WindowHints",
    "calibration_of",
    "explain",
    "explain_one",
    "family_of",
    "geometry_of",
    "objective_of",
    "resolve",
    "starts",
    "without_network",
]
