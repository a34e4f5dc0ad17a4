"""Gradient descent with momentum and decay, batched."""

from __future__ import annotations

from dataclasses import dataclass

import torch

from vig.optimizers.bounds import scales
from vig.optimizers.optimizer import Budget, Descent, Problem

STALL = 10
"""Steps over which the gain is compared with the budget's tolerance: single ones are small."""

GIVE_UP = 1e-9
"""A search ends when its rate has fallen to this."""


@dataclass(frozen=True)
class GradientDescent:
    """Settings.

    rate: of a step, the gradient being scaled: each parameter is counted in its own standard deviations, by
    the normal matrix's diagonal at the start (`scales`), so that 1 would be Newton's step if parameters did
    not depend on each other. momentum: share of the last step that is taken again; 0 for none. decay: step
    number k is taken at rate / (1 + decay k).

    A step that loses is undone, its momentum dropped and the rate halved; each that gains brings a tenth of
    the rate back, up to what is set.
    """

    rate: float = 0.1
    momentum: float = 0.9
    decay: float = 0.0

    def __call__(
        self, problem: Problem, starts: torch.Tensor, photo: torch.Tensor, sigma: float, budget: Budget
    ) -> Descent:
        """Maximise from starts (B, P'); see `Optimizer`."""
        count = len(starts)
        noise = torch.full((count,), sigma, dtype=problem.dtype, device=problem.device)
        points = starts.clone()
        start = problem(points, photo, noise)
        assert start.gradient is not None and start.normal is not None
        value, gradient = start.value.clone(), start.gradient.clone()
        scale = scales(start.normal.nan_to_num())
        velocity, rate = torch.zeros_like(points), torch.full_like(noise, self.rate)
        evaluations = torch.ones(count, dtype=torch.int64, device=problem.device)
        converged = torch.zeros(count, dtype=torch.bool, device=problem.device)
        earlier = value.clone()
        active = torch.isfinite(value).nonzero()[:, 0]
        for number in range(budget.iterations):
            if not len(active):
                break
            pace = rate[active, None] / (1 + self.decay * number)
            push = pace * gradient[active] / scale[active] ** 2
            here = points[active]
            trial = (here + self.momentum * velocity[active] + push).clamp(problem.lower, problem.upper)
            tried = problem(trial, photo[active], noise[active])
            assert tried.gradient is not None
            evaluations[active] += 1
            better = tried.value >= value[active]
            # What a bound stopped has no momentum left: the step that was made counts.
            velocity[active] = torch.where(better[:, None], trial - here, 0.0)
            rate[active] = torch.where(better, (1.1 * rate[active]).clamp_max(self.rate), rate[active] / 2)
            taken = active[better]
            points[taken], value[taken] = trial[better], tried.value[better]
            gradient[taken] = tried.gradient[better]
            done = rate[active] < GIVE_UP * self.rate
            if (number + 1) % STALL == 0:
                done |= value[active] - earlier[active] < budget.tolerance
                earlier[active] = value[active]
            converged[active[done]] = True
            active = active[~done]
        return Descent(points, value, evaluations, converged)
