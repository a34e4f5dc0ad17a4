"""BFGS and L-BFGS by scipy, one search after the other, in double precision and scaled parameters."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy  # which loads `optimize` where that is first used
import torch

from vig.search.optimizer import Budget
from vig_paper.optimizers.searching import Ended, held_by_bounds, scales
from vig_paper.optimizers.tensors import TensorProblem, of_tensors

EVALUATIONS_PER_STEP = 20
"""A search may value its problem this often for each iteration of its budget; then it ends."""


@dataclass(frozen=True)
class BFGS:
    """BFGS with an active set, as scipy's has no bounds.

    It runs over the parameters that no bound holds, and again from where it ended with those that are free
    there, until a run gains less than the tolerance.
    """

    @of_tensors
    def __call__(
        self, problem: TensorProblem, starts: torch.Tensor, photo: torch.Tensor, sigma: float, budget: Budget
    ) -> Ended:
        """Maximise from starts (B, P'); see `Optimizer`."""
        return _search_each(problem, starts, photo, sigma, budget, _bfgs)


@dataclass(frozen=True)
class LBFGS:
    """L-BFGS with bounds (Byrd, Lu, Nocedal and Zhu's L-BFGS-B).

    Attributes:
        memory: Steps back from which the curvature is estimated.
    """

    memory: int = 20

    @of_tensors
    def __call__(
        self, problem: TensorProblem, starts: torch.Tensor, photo: torch.Tensor, sigma: float, budget: Budget
    ) -> Ended:
        """Maximise from starts (B, P'); see `Optimizer`."""
        return _search_each(problem, starts, photo, sigma, budget, self._run)

    def _run(self, search: _Search) -> None:
        bounds = scipy.optimize.Bounds(
            search.scaled(search.problem.lower), search.scaled(search.problem.upper)
        )
        options = {
            "maxcor": self.memory,
            "maxiter": search.budget.iterations,
            "maxls": EVALUATIONS_PER_STEP,
            "maxfun": EVALUATIONS_PER_STEP * search.budget.iterations + 1,
            "ftol": 0.0,
            "gtol": 1e-12,
        }
        outcome = scipy.optimize.minimize(
            search.negative,
            search.scaled(search.point),
            jac=True,
            method="L-BFGS-B",
            bounds=bounds,
            callback=search.after_step,
            options=options,
        )
        # 0: the gradient vanished; 2: no point of the line is better. Nothing is left to gain either way.
        search.converged |= outcome.status in (0, 2)


class _SpentError(Exception):
    """The evaluations are spent."""


class _Search:
    """One search from `start` (P',): evaluation, best point, and stopping.

    Parameters are counted in their own standard deviations at the start (`scales`), so that the first step of
    a method that knows no curvature yet has a sensible length.
    """

    def __init__(
        self, problem: TensorProblem, start: torch.Tensor, photo: torch.Tensor, sigma: float, budget: Budget
    ):
        self.problem, self.photo, self.budget = problem, photo, budget
        self.noise = torch.full((1,), sigma, dtype=problem.dtype)
        self.point, self.value, self.evaluations, self.steps = start.clone(), -np.inf, 0, 0
        self.converged = False
        evaluation = self._evaluate(start)
        assert evaluation is not None and evaluation[2] is not None
        self.worst, self._last_evaluation = evaluation[0], (start, evaluation[0], evaluation[1])
        if not np.isfinite(evaluation[0]):
            self.scale, self.gradient = np.ones(len(start)), evaluation[1]
            return
        self.value, self.gradient = evaluation[0], evaluation[1]
        self.scale = scales(evaluation[2][None].double())[0].cpu().numpy()
        self._value_before = self.value

    def _evaluate(self, point: torch.Tensor) -> tuple[float, torch.Tensor, torch.Tensor | None]:
        if self.evaluations > EVALUATIONS_PER_STEP * self.budget.iterations:
            raise _SpentError
        self.evaluations += 1
        evaluation = self.problem(point[None], self.photo, self.noise)
        assert evaluation.gradient is not None and evaluation.normal is not None
        return float(evaluation.value[0]), evaluation.gradient[0].clone(), evaluation.normal[0]

    def scaled(self, point: torch.Tensor) -> np.ndarray:
        """A point (P',) in scipy's coordinates."""
        return point.double().cpu().numpy() * self.scale

    def negative(self, scaled: np.ndarray) -> tuple[float, np.ndarray]:
        """What scipy minimises, and its gradient: the problem at the nearest point within the bounds.

        Where the problem has no finite value it is as bad as the worst seen, falling towards the best.
        """
        unclamped = torch.from_numpy(scaled / self.scale).to(self.point)
        point = unclamped.clamp(self.problem.lower, self.problem.upper)
        if not torch.equal(point, self._last_evaluation[0]):
            value, gradient, _ = self._evaluate(point)
            self._last_evaluation = point, value, gradient
        _, value, gradient = self._last_evaluation
        if not np.isfinite(value) or not torch.isfinite(gradient).all():
            towards_best = scaled - self.scaled(self.point)
            return 1.0 - self.worst, towards_best / max(float(np.linalg.norm(towards_best)), 1e-12)
        self.worst = min(self.worst, value)
        if value > self.value:
            self.point, self.value, self.gradient = point, value, gradient
        inside = (unclamped == point) | torch.isclose(unclamped, point, rtol=1e-6, atol=0.0)
        return -value, -torch.where(inside, gradient, 0.0).double().cpu().numpy() / self.scale

    def after_step(self, intermediate_result: scipy.optimize.OptimizeResult) -> None:
        """scipy's callback: counts the step, and ends the search when it gained less than the tolerance."""
        self.steps += 1
        gain, self._value_before = self.value - self._value_before, self.value
        self.converged = gain < self.budget.tolerance
        if self.converged or self.steps >= self.budget.iterations:
            raise StopIteration

    def free(self) -> np.ndarray:
        """Which parameters (P',) bool no bound holds at the best point."""
        at_bound = held_by_bounds(self.point[None], self.gradient[None], self.problem)
        return ~at_bound[0].cpu().numpy()


def _search_each(
    problem: TensorProblem,
    starts: torch.Tensor,
    photo: torch.Tensor,
    sigma: float,
    budget: Budget,
    run: Callable[[_Search], None],
) -> Ended:
    """Run one search after the other from starts (B, P')."""
    searches = []
    for index, start in enumerate(starts):
        search = _Search(problem, start, photo[index : index + 1], sigma, budget)
        if np.isfinite(search.value) and budget.iterations:
            try:
                run(search)
            except _SpentError:
                search.converged = False
        searches.append(search)
    return Ended(
        torch.stack([search.point for search in searches]),
        torch.tensor([search.value for search in searches], dtype=torch.float64),
        torch.tensor([search.evaluations for search in searches]),
        torch.tensor([search.converged for search in searches], dtype=torch.bool),
    )


def _bfgs(search: _Search) -> None:
    while search.steps < search.budget.iterations:
        value_before, free = search.value, search.free()
        origin = search.scaled(search.point)
        search.converged = not free.any()
        if search.converged:
            return

        def negative(
            free_values: np.ndarray, origin: np.ndarray = origin, free: np.ndarray = free
        ) -> tuple[float, np.ndarray]:
            full_point = origin.copy()
            full_point[free] = free_values
            value, gradient = search.negative(full_point)
            return value, gradient[free]

        options = {"maxiter": search.budget.iterations - search.steps, "gtol": 1e-12}
        steps = search.steps
        scipy.optimize.minimize(
            negative, origin[free], jac=True, method="BFGS", callback=search.after_step, options=options
        )
        search.converged = search.value - value_before < search.budget.tolerance
        if search.converged or search.steps == steps:
            return
