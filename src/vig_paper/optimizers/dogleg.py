"""Powell's dogleg: Gauss-Newton within a trust region, batched."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import torch

from vig.search.optimizer import Budget, Descent, Problem, Searches, bounded_step, newton, scales


@dataclass(frozen=True)
class Dogleg:
    """Settings.

    Attributes:
        radius: Of the first trust region, each parameter in its own standard deviations (`scales`).
        least_radius: A search ends when its trust region is smaller.
    """

    radius: float = 100.0
    least_radius: float = 1e-3

    def __call__(
        self, problem: Problem, starts: torch.Tensor, photo: torch.Tensor, sigma: float, budget: Budget
    ) -> Descent:
        """Maximise from starts (B, P'); see `Optimizer`."""
        searches = Searches(problem, starts, photo, sigma)
        radius = torch.full_like(searches.noise, self.radius)
        for _ in range(budget.iterations):
            active = searches.active
            if not len(active):
                break
            here, gradient, normal = (
                part[active] for part in (searches.points, searches.gradient, searches.normal)
            )
            scale = scales(normal)
            solve = functools.partial(_dogleg, scale=scale, radius=radius[active])
            step, promised = bounded_step(here, gradient, normal, problem, solve)
            tried = searches.evaluate(active, here + step)
            gain = tried[0] - searches.value[active]
            ratio = (gain / promised.clamp_min(1e-9)).nan_to_num(nan=-1.0).to(radius.dtype)
            length = torch.linalg.vector_norm(step * scale, dim=1)
            wider = torch.where(ratio > 0.75, torch.maximum(radius[active], 3 * length), radius[active])
            radius[active] = torch.where(ratio < 0.25, 0.25 * torch.minimum(length, radius[active]), wider)
            better = gain > 0
            searches.move(active, here + step, tried, better)
            done = (better & (gain < budget.tolerance)) | (promised < 0.1 * budget.tolerance)
            searches.end(done | (radius[active] < self.least_radius))
        return searches.descent()


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
