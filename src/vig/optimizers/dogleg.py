"""Powell's dogleg: Gauss-Newton within a trust region, batched."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import torch

from vig.optimizers.bounds import bounded_step, held_by_bounds, newton, scales
from vig.optimizers.optimizer import Budget, Descent, Problem


@dataclass(frozen=True)
class Dogleg:
    """Settings.

    radius: of the first trust region, each parameter counted in its own standard deviations (`scales`).
    least_radius: a search ends when its trust region is smaller.
    """

    radius: float = 100.0
    least_radius: float = 1e-3

    def __call__(
        self, problem: Problem, starts: torch.Tensor, photo: torch.Tensor, sigma: float, budget: Budget
    ) -> Descent:
        """Maximise from starts (B, P'); see `Optimizer`."""
        count = len(starts)
        noise = torch.full((count,), sigma, dtype=problem.dtype, device=problem.device)
        points = starts.clone()
        start = problem(points, photo, noise)
        assert start.gradient is not None and start.normal is not None
        value, gradient, normal = start.value.clone(), start.gradient.clone(), start.normal.clone()
        radius = torch.full_like(noise, self.radius)
        evaluations = torch.ones(count, dtype=torch.int64, device=problem.device)
        converged = torch.zeros(count, dtype=torch.bool, device=problem.device)
        active = torch.isfinite(value).nonzero()[:, 0]
        for _ in range(budget.iterations):
            if not len(active):
                break
            here, slope, matrix = points[active], gradient[active], normal[active]
            scale = scales(matrix)
            step, promised = bounded_step(
                here,
                slope,
                matrix,
                problem,
                held_by_bounds(here, slope, problem),
                functools.partial(_dogleg, scale=scale, radius=radius[active]),
            )
            trial = here + step
            tried = problem(trial, photo[active], noise[active])
            assert tried.gradient is not None and tried.normal is not None
            evaluations[active] += 1
            gain = tried.value - value[active]
            ratio = (gain / promised.clamp_min(1e-9)).nan_to_num(nan=-1.0).to(noise.dtype)
            length = torch.linalg.vector_norm(step * scale, dim=1)
            wider = torch.where(ratio > 0.75, torch.maximum(radius[active], 3 * length), radius[active])
            radius[active] = torch.where(ratio < 0.25, 0.25 * torch.minimum(length, radius[active]), wider)
            better = gain > 0
            taken = active[better]
            points[taken], value[taken] = trial[better], tried.value[better]
            gradient[taken], normal[taken] = tried.gradient[better], tried.normal[better]
            done = (better & (gain < budget.tolerance)) | (promised < 0.1 * budget.tolerance)
            done |= radius[active] < self.least_radius
            converged[active[done]] = True
            active = active[~done]
        return Descent(points, value, evaluations, converged)


def _dogleg(
    right: torch.Tensor, matrix: torch.Tensor, free: torch.Tensor, scale: torch.Tensor, radius: torch.Tensor
) -> torch.Tensor:
    """The point (B, P') of Powell's path, gradient's best point to Newton's, that is `radius` (B,) away."""
    full = newton(right, matrix, free) * scale
    along = right / scale
    curvature = torch.einsum("bi,bij,bj->b", along / scale, matrix, along / scale)
    size = (along * along).sum(1)
    steepest = along * (size / curvature.clamp_min(1e-12 * size).clamp_min(1e-30))[:, None]
    reach = torch.linalg.vector_norm(steepest, dim=1)
    short = steepest * (radius / reach.clamp_min(1e-30)).clamp_max(1.0)[:, None]
    # |steepest + t (full - steepest)| = radius, the larger root.
    leg = full - steepest
    a, b = (leg * leg).sum(1).clamp_min(1e-30), (steepest * leg).sum(1)
    root = (b * b + a * (radius**2 - reach**2)).clamp_min(0.0).sqrt()
    bent = steepest + ((root - b) / a).clamp(0.0, 1.0)[:, None] * leg
    inside = torch.linalg.vector_norm(full, dim=1) <= radius
    path = torch.where((reach < radius)[:, None], bent, short)
    return torch.where(inside[:, None], full, path) / scale * free
