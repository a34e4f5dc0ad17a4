"""What every optimiser is and returns."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import torch

from vig.inference.objective import Objective


@dataclass(frozen=True)
class Descent:
    """Where B searches ended.

    points (B, P'); value (B,) float64, the objective there (higher is better); evaluations (B,) int, how
    many times the objective was valued for each; converged (B,) bool: it stopped because nothing was gained,
    not because its budget ended.
    """

    points: torch.Tensor
    value: torch.Tensor
    evaluations: torch.Tensor
    converged: torch.Tensor


class Optimizer(Protocol):
    """Maximises an objective from B starts within its bounds."""

    def __call__(
        self, objective: Objective, starts: torch.Tensor, photo: torch.Tensor, sigma: float
    ) -> Descent:
        """starts (B, P') within the bounds; photo (B,) int; sigma: the noise's standard deviation."""
        ...
