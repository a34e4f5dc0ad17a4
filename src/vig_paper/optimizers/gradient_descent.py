"""Gradient descent with momentum and decay, batched."""

from __future__ import annotations

from dataclasses import dataclass

import torch

from vig.search.optimizer import Budget, Descent, Problem, Searches, scales

STALL = 10
"""Steps over which the gain is compared with the budget's tolerance: single ones are small."""

GIVE_UP = 1e-9
"""A search ends when its rate has fallen to this."""


@dataclass(frozen=True)
class GradientDescent:
    """Settings.

    A step that loses is undone, its momentum dropped and the rate halved; each that gains brings a tenth of
    the rate back, up to `rate`.

    Attributes:
        rate: Of a step, each parameter in its own standard deviations at the start (`scales`): 1 would be
            Newton's step if parameters did not depend on each other.
        momentum: Share of the last step that is taken again; 0 for none.
        decay: Step number k is taken at rate / (1 + decay k).
    """

    rate: float = 0.1
    momentum: float = 0.9
    decay: float = 0.0

    def __call__(
        self, problem: Problem, starts: torch.Tensor, photo: torch.Tensor, sigma: float, budget: Budget
    ) -> Descent:
        """Maximise from starts (B, P'); see `Optimizer`."""
        searches = Searches(problem, starts, photo, sigma)
        scale = scales(searches.normal.nan_to_num())
        velocity, rate = torch.zeros_like(searches.points), torch.full_like(searches.noise, self.rate)
        earlier = searches.value.clone()
        for number in range(budget.iterations):
            active = searches.active
            if not len(active):
                break
            here = searches.points[active]
            pace = rate[active, None] / (1 + self.decay * number)
            push = pace * searches.gradient[active] / scale[active] ** 2
            trial = (here + self.momentum * velocity[active] + push).clamp(problem.lower, problem.upper)
            tried = searches.evaluate(active, trial)
            better = tried[0] >= searches.value[active]
            # What a bound stopped has no momentum left: the step that was made counts.
            velocity[active] = torch.where(better[:, None], trial - here, 0.0)
            rate[active] = torch.where(better, (1.1 * rate[active]).clamp_max(self.rate), rate[active] / 2)
            searches.move(active, trial, tried, better)
            done = rate[active] < GIVE_UP * self.rate
            if (number + 1) % STALL == 0:
                done |= searches.value[active] - earlier[active] < budget.tolerance
                earlier[active] = searches.value[active]
            searches.end(done)
        return searches.descent()
