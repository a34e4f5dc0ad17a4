"""Fits whose place was found in a photo, not given: the photo may not show the object at all."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from vig.inference.confidence import unsure
from vig.inference.settings import Fit, Verdict

LEAST_PRESENT = 0.6
"""Probability of presence below which the object counts as absent, and a place as none of several or of a
lost one: chosen on the photographs of docs/results.md, whose own objects reach .69 and more, small crops of
decorated mugs .54."""


def lower_by_presence(fit: Fit, present: float, name: str) -> Fit:
    """Return a fit whose place was found, not given; the object is of the class with this probability."""
    if present < LEAST_PRESENT:
        reason = f"no {name} was found in the photo; give a box if there is one"
        nothing = np.zeros_like(fit.visible)
        hidden = np.zeros_like(fit.mask)
        absent = replace(fit, verdict=Verdict.ABSENT, reason=reason, confidence=0.0, alternatives=())
        absent = replace(absent, present=present, mask_confidence=0.0, mask_trusted=False)
        return replace(absent, visible=nothing, coverage=nothing, mask=hidden, mask_by_pixel=hidden)
    return replace(lower_confidence(fit, present, name), present=present)


def lower_confidence(fit: Fit, factor: float, name: str) -> Fit:
    """Return a fit that may show no object of the class, its probabilities times a factor."""
    confidence, mask_confidence = factor * fit.confidence, factor * fit.mask_confidence
    views = tuple(replace(view, probability=factor * view.probability) for view in fit.alternatives)
    sure = fit.mask_trusted and mask_confidence >= fit.mask_threshold
    doubted = replace(fit, confidence=confidence, mask_confidence=mask_confidence, alternatives=views)
    doubted = replace(doubted, mask_trusted=sure)
    if fit.verdict is Verdict.TRUSTED and not confidence >= fit.view_threshold:
        reason = f"what was found in the photo may be no {name}; give a box if it is one"
        doubted = replace(doubted, verdict=Verdict.AMBIGUOUS, reason=reason)
    elif fit.reason == unsure(fit.confidence, fit.view_threshold):
        doubted = replace(doubted, reason=unsure(confidence, fit.view_threshold))
    return doubted
