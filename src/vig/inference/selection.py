"""Selection: of where descents ended, the best by evidence and view probability, and its best rival."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch

from vig.inference.objective import Objective
from vig.inference.refinement import DISTINCT_AZIMUTH, Ends
from vig.scene import Latents, angle_difference

AMBIGUOUS_NATS = 30.0
"""A view whose score lies less behind than this is a rival."""


@dataclass(frozen=True)
class Selection:
    """The explanation that was chosen.

    Attributes:
        point: (1, P') of the objective.
        reverted: Whether it is the recognition model's guess, which no end had more evidence than.
        start_evidence: Log posterior at that guess, nats.
        evaluations: Of the objective, by all starts together.
        gap: Nats by which the best end of another view lies behind; infinite when there is none.
        close: Whether that is less than `AMBIGUOUS_NATS`.
        alternative: That end when it is close, else the recognition model's guess.
        turned_deg: By how far the alternative is turned about the vertical.
    """

    point: torch.Tensor
    reverted: bool
    start_evidence: float
    evaluations: int
    gap: float
    close: bool
    alternative: Latents
    turned_deg: float

    @property
    def elsewhere(self) -> bool:
        """Whether the alternative is another view."""
        return self.turned_deg > math.degrees(DISTINCT_AZIMUTH)


def select(objective: Objective, ends: Ends, guess: Latents, sigma: float) -> Selection:
    """Choose the end of the best score, or the network's `guess` (B = 1) if it has no more evidence."""
    best = int(ends.scores.argmax())
    start = objective.point(guess)
    zero, noise = torch.zeros(1, dtype=torch.int32), torch.tensor([sigma])
    start_evidence = float(objective(start, zero, noise, derivatives=False).value)
    reverted = float(ends.evidence[best]) <= start_evidence
    point = start if reverted else ends.points[best : best + 1]
    azimuth = objective.latents(ends.points).azimuth
    other_view = angle_difference(azimuth, azimuth[best]).abs() > DISTINCT_AZIMUTH
    gaps = torch.where(other_view, ends.scores[best] - ends.scores, math.inf)
    gap, rival = float(gaps.min()), int(gaps.argmin())
    close = gap < AMBIGUOUS_NATS
    alternative = objective.latents(ends.points[rival : rival + 1] if close else start)
    turned = abs(float(angle_difference(alternative.azimuth, objective.latents(point).azimuth)))
    return Selection(
        point, reverted, start_evidence, ends.evaluations, gap, close, alternative, math.degrees(turned)
    )
