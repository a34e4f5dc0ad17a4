"""Fits whose place was found in a photo, not given: the photo may not show the object at all."""

from dataclasses import replace

import numpy as np

from vig.inference.settings import Fit, Verdict

MIN_PRESENT = 0.5
"""Probability of presence below which the object counts as absent; also that of each of several objects, and
of a tracked one that is looked for again."""
TRUSTED_PRESENCE = 0.7
"""Probability of presence from which views and masks are trusted; chosen on the photos of docs/results.md."""


def judge_presence(fit: Fit, present: float, name: str) -> Fit:
    """Return a fit whose place was found, not given; the object is of the class with this probability.

    The confidence remains that of the view of an object that is there; 0 where it counts as absent.
    """
    sure = present >= TRUSTED_PRESENCE
    judged = replace(fit, present=present, mask_trusted=fit.mask_trusted and sure)
    if present < MIN_PRESENT:
        reason = f"no {name} was found in the photo; give a box if there is one"
        nothing = np.zeros_like(fit.visible)
        hidden = np.zeros_like(fit.mask)
        absent = replace(judged, verdict=Verdict.ABSENT, reason=reason, confidence=0.0, alternatives=())
        absent = replace(absent, mask_confidence=0.0)
        return replace(absent, visible=nothing, coverage=nothing, mask=hidden, mask_by_pixel=hidden)
    if fit.verdict is Verdict.TRUSTED and not sure:
        reason = f"what was found in the photo may be no {name}; give a box if it is one"
        return replace(judged, verdict=Verdict.AMBIGUOUS, reason=reason)
    return judged
