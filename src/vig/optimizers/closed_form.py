"""Light and albedo in closed form, given geometry.

With the posterior of each pixel being visible as its weight, the colour albedo x irradiance is linear in the
light while the albedo rests, and in the albedo while the light rests: each is a weighted least squares
problem, whose solution is one Gauss-Newton step on its block of the normal matrix and gradient. The weights
are those of the last step (iteratively reweighted least squares).
"""

from __future__ import annotations

from dataclasses import dataclass

import torch

from vig.optimizers.bounds import bounded_step, held_by_bounds, newton
from vig.optimizers.optimizer import Budget, Descent, Optimizer, Problem

LIGHT, ALBEDO = slice(-12, -3), slice(-15, -12)
"""Where they are in a point of `Objective`, counted from its end: framing is the last three."""


@dataclass(frozen=True)
class ClosedForm:
    """An optimiser that moves only light and albedo, within their bounds: an iteration solves one of them.

    blocks: solved in turn, from the first; each must be linear given all others. A step that loses is undone.
    """

    blocks: tuple[slice, ...] = (LIGHT, ALBEDO)

    def __call__(
        self, problem: Problem, starts: torch.Tensor, photo: torch.Tensor, sigma: float, budget: Budget
    ) -> Descent:
        """Maximise from starts (B, P'); see `Optimizer`. Converged: a round of blocks gained too little."""
        count = len(starts)
        noise = torch.full((count,), sigma, dtype=problem.dtype, device=problem.device)
        points = starts.clone()
        start = problem(points, photo, noise)
        assert start.gradient is not None and start.normal is not None
        value, gradient, normal = start.value.clone(), start.gradient.clone(), start.normal.clone()
        evaluations = torch.ones(count, dtype=torch.int64, device=problem.device)
        converged = torch.zeros(count, dtype=torch.bool, device=problem.device)
        earlier = value.clone()
        active = torch.isfinite(value).nonzero()[:, 0]
        for number in range(budget.iterations):
            if not len(active):
                break
            held = held_by_bounds(points[active], gradient[active], problem)
            others = torch.ones_like(held)
            others[:, self.blocks[number % len(self.blocks)]] = False
            step, _ = bounded_step(
                points[active], gradient[active], normal[active], problem, held | others, newton
            )
            trial = points[active] + step
            tried = problem(trial, photo[active], noise[active])
            assert tried.gradient is not None and tried.normal is not None
            evaluations[active] += 1
            better = tried.value > value[active]
            taken = active[better]
            points[taken], value[taken] = trial[better], tried.value[better]
            gradient[taken], normal[taken] = tried.gradient[better], tried.normal[better]
            if (number + 1) % len(self.blocks) == 0:
                done = value[active] - earlier[active] < budget.tolerance
                earlier[active] = value[active]
                converged[active[done]] = True
                active = active[~done]
        return Descent(points, value, evaluations, converged)


@dataclass(frozen=True)
class Alternating:
    """Turns of a closed form's steps and an optimiser's, in that order, until a turn gains too little.

    solved, descended: iterations of each in a turn at most; both count in the budget. With more `descended`
    than the budget has, the closed form is a start and nothing else.
    """

    optimizer: Optimizer
    closed_form: ClosedForm = ClosedForm()
    solved: int = 4
    descended: int = 8

    def __call__(
        self, problem: Problem, starts: torch.Tensor, photo: torch.Tensor, sigma: float, budget: Budget
    ) -> Descent:
        """Maximise from starts (B, P'); see `Optimizer`."""
        count, left = len(starts), budget.iterations
        points, active = starts.clone(), torch.arange(count, device=problem.device)
        value = torch.full((count,), -torch.inf, dtype=torch.float64, device=problem.device)
        evaluations = torch.zeros(count, dtype=torch.int64, device=problem.device)
        converged = torch.zeros(count, dtype=torch.bool, device=problem.device)
        parts = ((self.closed_form, self.solved), (self.optimizer, self.descended))
        while len(active):
            before = value[active]
            for optimizer, most in parts:
                share = min(most, left)
                left -= share
                if not share and evaluations.all():
                    break
                end = optimizer(
                    problem, points[active], photo[active], sigma, Budget(share, budget.tolerance)
                )
                points[active], value[active] = end.points, end.value
                evaluations[active] += end.evaluations
                converged[active] = end.converged
            if not left:
                break
            done = ~(value[active] - before >= budget.tolerance)
            converged[active[done]] = torch.isfinite(value[active[done]])
            active = active[~done]
        return Descent(points, value, evaluations, converged)
