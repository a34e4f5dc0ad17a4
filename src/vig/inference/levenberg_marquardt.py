"""Robust Gauss-Newton with Levenberg-Marquardt damping, batched: the default.

The inlier posteriors weigh the normal matrix (iteratively reweighted least squares), the exact gradient
drives it, bounds are met by an active set in the step itself. Damping follows Nielsen (1999).
"""

from __future__ import annotations

from dataclasses import dataclass

import torch

from vig.inference.optimizer import Budget, Descent, Problem


@dataclass(frozen=True)
class LevenbergMarquardt:
    """Settings.

    damping: first multiple of the normal matrix's diagonal. give_up: the damping at which a search ends.
    """

    damping: float = 1.0
    give_up: float = 1e4

    def __call__(
        self, objective: Problem, starts: torch.Tensor, photo: torch.Tensor, sigma: float, budget: Budget
    ) -> Descent:
        """Maximise from starts (B, P'); see `Optimizer`."""
        count = len(starts)
        noise = torch.full((count,), sigma, dtype=objective.dtype, device=objective.device)
        points = starts.clone()
        start = objective(points, photo, noise)
        assert start.gradient is not None and start.normal is not None
        value, gradient, normal = start.value, start.gradient.clone(), start.normal.clone()
        damping = torch.full((count,), self.damping, dtype=objective.dtype, device=objective.device)
        growth = torch.full_like(damping, 3.0)
        evaluations = torch.ones(count, dtype=torch.int64, device=objective.device)
        active = torch.isfinite(value).nonzero()[:, 0]
        for _ in range(budget.iterations):
            if not len(active):
                break
            step, predicted = self._step(
                points[active], gradient[active], normal[active], damping[active], objective
            )
            trial = points[active] + step
            tried = objective(trial, photo[active], noise[active])
            assert tried.gradient is not None and tried.normal is not None
            evaluations[active] += 1
            gain = tried.value - value[active]
            better = gain > 0
            ratio = (gain / predicted.clamp_min(1e-9).double()).to(damping.dtype)
            # Nielsen: shrink smoothly with the gain ratio, grow ever faster while steps fail.
            shrink = (1 - (2 * ratio - 1) ** 3).clamp(1 / 3, 2.0)
            damping[active] = torch.where(
                better, damping[active] * shrink, damping[active] * growth[active]
            ).clamp_min(1e-7)
            growth[active] = torch.where(better, torch.full_like(ratio, 3.0), growth[active] * 2)
            taken = active[better]
            points[taken], value[taken] = trial[better], tried.value[better]
            gradient[taken], normal[taken] = tried.gradient[better], tried.normal[better]
            done = (better & (gain < budget.tolerance)) | (damping[active] > self.give_up)
            done |= predicted < 0.1 * budget.tolerance
            active = active[~done]
        converged = torch.isfinite(value)
        converged[active] = False
        return Descent(points, value, evaluations, converged)

    def _step(
        self,
        points: torch.Tensor,
        gradient: torch.Tensor,
        normal: torch.Tensor,
        damping: torch.Tensor,
        objective: Problem,
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """Damped step (B, P') within the bounds, and the gain that the quadratic model promises (B,)."""
        lower, upper = objective.lower, objective.upper
        held = ((points <= lower) & (gradient <= 0)) | ((points >= upper) & (gradient >= 0))
        held |= lower == upper
        step = torch.zeros_like(points)
        diagonal = torch.diagonal(normal, dim1=1, dim2=2)
        floor = 1e-6 * diagonal.amax(1, keepdim=True)
        damped = damping[:, None] * (diagonal + floor) + 1e-9 * floor
        for _ in range(3):
            free = (~held).to(points.dtype)
            matrix = normal * (free[:, :, None] * free[:, None, :])
            torch.diagonal(matrix, dim1=1, dim2=2).add_(damped * free + (1 - free))
            right = (gradient - (normal @ (step * held)[:, :, None])[:, :, 0]) * free
            factor, failed = torch.linalg.cholesky_ex(matrix)
            solved = torch.cholesky_solve(right[:, :, None], factor)[:, :, 0]
            usable = (failed == 0)[:, None] & torch.isfinite(solved)
            if not usable.all():
                solved = torch.where(usable, solved, gradient / (diagonal + floor) * 0.1)
            step = torch.where(held, step, solved)
            over = ((points + step < lower) | (points + step > upper)) & ~held
            if not over.any():
                break
            # Rest on the bound that would be passed and solve the others again.
            step = torch.where(over, (points + step).clamp(lower, upper) - points, step)
            held = held | over
        step = (points + step).clamp(lower, upper) - points
        curved = (normal @ step[:, :, None])[:, :, 0]
        return step, ((gradient - 0.5 * curved) * step).sum(1)
