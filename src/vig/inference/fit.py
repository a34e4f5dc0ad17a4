"""What is answered for a photo."""

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
    """One photo explained.

    latents: one (B = 1). framing (3,): shift of the image in widths and log magnification. deviation (P,):
    one standard deviation of each latent, from the curvature at the fit, widened by the class's calibration;
    without one optimistic, as the noise of neighbouring pixels is taken as independent. confidence:
    probability that the view is right, NaN without a calibration; clues (C,): what it is judged by, see
    `calibration.CLUES`. visible (H, W): posterior of each pixel showing the object;
    mask, amodal (H, W) bool: its visible pixels, and all that it covers; mask_by_pixel: as the
    paper's robust model has the visible ones, each pixel by itself. evidence, start_evidence: log
    posterior in nats at the fit and at the recognition model's guess. reason: one sentence. alternative: when
    ambiguous, the other explanation (B = 1). evaluations: of the objective, all starts together.
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
    clues: torch.Tensor
    evidence: float
    start_evidence: float
    evaluations: int
    alternative: Latents | None
