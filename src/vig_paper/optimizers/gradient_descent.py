"""Gradient descent with momentum and decay, batched."""

from __future__ import annotations

from dataclasses import dataclass

import torch

from vig.search.optimizer import Budget
from vig_paper.optimizers.searching import Ended, Searches, scales
from vig_paper.optimizers.tensors import TensorProblem, of_tensors

STALL_STEPS = 10
"""Steps over which the gain is compared with the budget's tolerance: single ones are small."""

MIN_RATE_SHARE = 1e-9
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

    @of_tensors
    def __call__(
        self, problem: TensorProblem, starts: torch.Tensor, photo: torch.Tensor, sigma: float, budget: Budget
    ) -> Ended:
        """Maximise from starts (B, P'); see `Optimizer`."""
        searches = Searches(problem, starts, photo, sigma)
        scale = scales(searches.normal.nan_to_num())
        velocity, rate = torch.zeros_like(searches.points), torch.full_like(searches.noise, self.rate)
        value_before = searches.value.clone()
        for number in range(budget.iterations):
            active = searches.active
            if not len(active):
                break
            points = searches.points[active]
            current_rate = rate[active, None] / (1 + self.decay * number)
            gradient_step = current_rate * searches.gradient[active] / scale[active] ** 2
            trial = (points + self.momentum * velocity[active] + gradient_step).clamp(
                problem.lower, problem.upper
            )
            evaluation = searches.evaluate(active, trial)
            better = evaluation[0] >= searches.value[active]
            # The velocity is the step after clamping: a parameter at its bound keeps no momentum.
            velocity[active] = torch.where(better[:, None], trial - points, 0.0)
            rate[active] = torch.where(better, (1.1 * rate[active]).clamp_max(self.rate), rate[active] / 2)
            searches.move(active, trial, evaluation, better)
            done = rate[active] < MIN_RATE_SHARE * self.rate
            if (number + 1) % STALL_STEPS == 0:
                done |= searches.value[active] - value_before[active] < budget.tolerance
                value_before[active] = searches.value[active]
            searches.end(done)
        return searches.descent()
