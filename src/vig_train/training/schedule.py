"""The learning rate over a training."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class Schedule:
    """Learning rate by step: a linear rise over a twentieth, then half a cosine down to a hundredth."""

    highest: float
    steps: int

    def __call__(self, step: int) -> float:
        rise = max(1, self.steps // 20)
        if step < rise:
            return self.highest * (step + 1) / rise
        share = (step - rise) / max(1, self.steps - rise)
        return self.highest * (0.01 + 0.99 * 0.5 * (1 + math.cos(math.pi * min(1.0, share))))
