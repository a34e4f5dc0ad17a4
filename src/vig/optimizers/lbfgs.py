"""L-BFGS with bounds, by scipy (Byrd, Lu, Nocedal and Zhu's L-BFGS-B)."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from scipy.optimize import Bounds, minimize

from vig.optimizers.optimizer import Budget, Descent, Problem
from vig.optimizers.scipy_search import EVALUATIONS_PER_STEP, Search, search_each


@dataclass(frozen=True)
class LBFGS:
    """Settings: how many steps back the curvature is remembered. One search after the other."""

    memory: int = 20

    def __call__(
        self, problem: Problem, starts: torch.Tensor, photo: torch.Tensor, sigma: float, budget: Budget
    ) -> Descent:
        """Maximise from starts (B, P'); see `Optimizer`."""
        return search_each(problem, starts, photo, sigma, budget, self._run)

    def _run(self, search: Search) -> None:
        bounds = Bounds(search.scaled(search.problem.lower), search.scaled(search.problem.upper))
        options = {
            "maxcor": self.memory,
            "maxiter": search.budget.iterations,
            "maxls": EVALUATIONS_PER_STEP,
            "maxfun": EVALUATIONS_PER_STEP * search.budget.iterations + 1,
            "ftol": 0.0,
            "gtol": 1e-12,
        }
        found = minimize(
            search.negative,
            search.scaled(search.point),
            jac=True,
            method="L-BFGS-B",
            bounds=bounds,
            callback=search.after_step,
            options=options,
        )
        # 0: the gradient vanished; 2: no point of the line is better. Nothing is left to gain either way.
        search.converged |= found.status in (0, 2)
