"""Nonlinear conjugate gradient (Polak-Ribiere, Wolfe line search), as the paper's, by scipy."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from scipy.optimize import minimize

from vig.inference.optimizer import Budget, Descent, Problem


@dataclass(frozen=True)
class ConjugateGradient:
    """Settings: at most `iterations` line searches of each search; one search after the other.

    Outside its bounds the objective is that of the nearest point within, so bounds hold in the result.
    """

    def __call__(
        self, objective: Problem, starts: torch.Tensor, photo: torch.Tensor, sigma: float, budget: Budget
    ) -> Descent:
        """Maximise from starts (B, P'); see `Optimizer`."""
        results = [
            self._one(objective, start, photo[i : i + 1], sigma, budget) for i, start in enumerate(starts)
        ]
        points, values, evaluations, converged = zip(*results, strict=True)
        return Descent(
            torch.stack(points),
            torch.tensor(values, dtype=torch.float64),
            torch.tensor(evaluations),
            torch.tensor(converged),
        )

    def _one(
        self, objective: Problem, start: torch.Tensor, photo: torch.Tensor, sigma: float, budget: Budget
    ) -> tuple[torch.Tensor, float, int, bool]:
        noise = torch.full((1,), sigma, dtype=objective.dtype, device=objective.device)
        best: list = [-np.inf, start]

        def negative(vector: np.ndarray) -> tuple[float, np.ndarray]:
            raw = torch.from_numpy(vector).to(start)
            point = raw.clamp(objective.lower, objective.upper)
            valued = objective(point[None], photo, noise)
            assert valued.gradient is not None
            value = float(valued.value[0])
            if value > best[0]:
                best[:] = value, point
            gradient = torch.where(point == raw, valued.gradient[0], 0.0)
            return -value, -gradient.double().cpu().numpy()

        first = start.double().cpu().numpy()
        found = minimize(negative, first, jac=True, method="CG", options={"maxiter": budget.iterations})
        return best[1], best[0], int(found.nfev), bool(found.success)
