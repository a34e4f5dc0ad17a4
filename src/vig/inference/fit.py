"""The result of fitting one photo."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import torch

from vig.scene import Latents


class Verdict(Enum):
    """How far an explanation can be believed; the value is a sentence for the user."""

    TRUSTED = "the fit explains the photo better than the recognition model's guess"
    REVERTED = "the fit went astray; this is the recognition model's guess"
    AMBIGUOUS = "more than one explanation is within reach of the evidence"
    FAILED = "nothing of the object could be recognised in the photo"


@dataclass(frozen=True)
class Fit:
    """One photo (H, W) explained.

    Attributes:
        latents: One (B = 1).
        framing: (3,) shift of the image in widths, right and down, and log magnification.
        deviation: (P,) standard deviations, from the curvature at the fit, widened by a calibration;
            without one too small, as the noise of neighbouring pixels is taken as independent.
        visible: (H, W) posterior probability that a pixel shows the object.
        mask: (H, W) bool, the object's visible pixels.
        mask_by_pixel: (H, W) bool, the same by the paper's robust model, each pixel by itself.
        amodal: (H, W) bool, all pixels that the object covers.
        verdict: How far to believe it.
        reason: One sentence why.
        confidence: Probability that the view is right; NaN without a calibration.
        confidence_features: (C,) float64, what the confidence follows from; see `CONFIDENCE_FEATURES`.
        evidence: Log posterior at the fit, nats.
        start_evidence: Log posterior at the recognition model's guess, nats.
        evaluations: Of the objective, by all starts together.
        alternative: The other explanation (B = 1) when ambiguous.
    """

    latents: Latents
    framing: torch.Tensor
    deviation: torch.Tensor
    visible: torch.Tensor
    mask: torch.Tensor
    mask_by_pixel: torch.Tensor
    amodal: torch.Tensor
    verdict: Verdict
    reason: str
    confidence: float
    confidence_features: torch.Tensor
    evidence: float
    start_evidence: float
    evaluations: int
    alternative: Latents | None
