"""BFGS by scipy, with an active set for the bounds."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from scipy.optimize import minimize

from vig.optimizers.optimizer import Budget, Descent, Problem
from vig.optimizers.scipy_search import Search, search_each


@dataclass(frozen=True)
class BFGS:
    """One search after the other.

    scipy's knows no bounds: it runs over the parameters that none holds, the others resting, and again from
    where it ended with those that are free there, until a run gains less than the tolerance.
    """

    def __call__(
        self, problem: Problem, starts: torch.Tensor, photo: torch.Tensor, sigma: float, budget: Budget
    ) -> Descent:
        """Maximise from starts (B, P'); see `Optimizer`."""
        return search_each(problem, starts, photo, sigma, budget, _run)


def _run(search: Search) -> None:
    while search.steps < search.budget.iterations:
        before, free = search.value, search.free()
        origin = search.scaled(search.point)
        search.converged = not free.any()
        if search.converged:
            return

        def negative(
            part: np.ndarray, origin: np.ndarray = origin, free: np.ndarray = free
        ) -> tuple[float, np.ndarray]:
            whole = origin.copy()
            whole[free] = part
            value, gradient = search.negative(whole)
            return value, gradient[free]

        options = {"maxiter": search.budget.iterations - search.steps, "gtol": 1e-12}
        steps = search.steps
        minimize(negative, origin[free], jac=True, method="BFGS", callback=search.after_step, options=options)
        search.converged = search.value - before < search.budget.tolerance
        if search.converged or search.steps == steps:
            return
