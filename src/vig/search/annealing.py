"""Any optimiser at falling noise: a wide basin is searched before a narrow one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vig.search.optimizer import Budget, Descent, Optimizer, Problem


@dataclass(frozen=True)
class Annealed:
    """Runs of `optimizer` under each multiple of the noise in turn, each from where the last one ended.

    sigmas: falling multiples, the last one 1. They share the budget's iterations evenly. A search that ends
    lower, under the noise itself, than it began ends at its start.
    """

    optimizer: Optimizer
    sigmas: tuple[float, ...] = (4.0, 2.0, 1.0)

    def __post_init__(self) -> None:
        if not self.sigmas or self.sigmas[-1] != 1 or list(self.sigmas) != sorted(self.sigmas, reverse=True):
            raise ValueError(f"sigmas must fall to 1; got {self.sigmas}")

    def __call__(
        self, problem: Problem, starts: np.ndarray, photo: np.ndarray, sigma: float, budget: Budget
    ) -> Descent:
        """Maximise from starts (B, P'); see `Optimizer`."""
        count, rounds = len(starts), len(self.sigmas)
        noise = np.full(count, sigma, problem.dtype)
        first = problem(starts, photo, noise, derivatives=False).value
        evaluations = np.ones(count, np.int64)
        points = starts
        for number, multiple in enumerate(self.sigmas):
            share = budget.iterations * (number + 1) // rounds - budget.iterations * number // rounds
            end = self.optimizer(problem, points, photo, sigma * multiple, Budget(share, budget.tolerance))
            evaluations = evaluations + end.evaluations
            points = end.points
        worse = ~(end.value >= first)
        points = np.where(worse[:, None], starts, points)
        value = np.where(worse, first, end.value)
        return Descent(points, value, evaluations, end.converged & ~worse)
