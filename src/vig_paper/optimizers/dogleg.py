"""Powell's dogleg: Gauss-Newton within a trust region, batched."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import torch

from vig.search.optimizer import Budget
from vig_paper.optimizers.searching import Ended, Searches, bounded_step, newton, scales
from vig_paper.optimizers.tensors import TensorProblem, of_tensors


@dataclass(frozen=True)
class Dogleg:
    """Settings.

    Attributes:
        radius: Of the first trust region, each parameter in its own standard deviations (`scales`).
        least_radius: A search ends when its trust region is smaller.
    """

    radius: float = 100.0
    least_radius: float = 1e-3

    @of_tensors
    def __call__(
        self, problem: TensorProblem, starts: torch.Tensor, photo: torch.Tensor, sigma: float, budget: Budget
    ) -> Ended:
        """Maximise from starts (B, P'); see `Optimizer`."""
        searches = Searches(problem, starts, photo, sigma)
        radius = torch.full_like(searches.noise, self.radius)
        for _ in range(budget.iterations):
            active = searches.active
            if not len(active):
                break
            points, gradient, normal = (
                part[active] for part in (searches.points, searches.gradient, searches.normal)
            )
            scale = scales(normal)
            solve = functools.partial(_dogleg, scale=scale, radius=radius[active])
            step, predicted_gain = bounded_step(points, gradient, normal, problem, solve)
            evaluation = searches.evaluate(active, points + step)
            gain = evaluation[0] - searches.value[active]
            ratio = (gain / predicted_gain.clamp_min(1e-9)).nan_to_num(nan=-1.0).to(radius.dtype)
            length = torch.linalg.vector_norm(step * scale, dim=1)
            wider = torch.where(ratio > 0.75, torch.maximum(radius[active], 3 * length), radius[active])
            radius[active] = torch.where(ratio < 0.25, 0.25 * torch.minimum(length, radius[active]), wider)
            better = gain > 0
            searches.move(active, points + step, evaluation, better)
            done = (better & (gain < budget.tolerance)) | (predicted_gain < 0.1 * budget.tolerance)
            searches.end(done | (radius[active] < self.least_radius))
        return searches.descent()


def _dogleg(
    gradient: torch.Tensor,
    matrix: torch.Tensor,
    free: torch.Tensor,
    scale: torch.Tensor,
    radius: torch.Tensor,
) -> torch.Tensor:
    """The point (B, P') of Powell's path, gradient's best point to Newton's, that is `radius` (B,) away."""
    newton_step = newton(gradient, matrix, free) * scale
    scaled_gradient = gradient / scale
    curvature = torch.einsum("bi,bij,bj->b", scaled_gradient / scale, matrix, scaled_gradient / scale)
    squared_norm = (scaled_gradient * scaled_gradient).sum(1)
    steepest = (
        scaled_gradient * (squared_norm / curvature.clamp_min(1e-12 * squared_norm).clamp_min(1e-30))[:, None]
    )
    steepest_length = torch.linalg.vector_norm(steepest, dim=1)
    along_gradient = steepest * (radius / steepest_length.clamp_min(1e-30)).clamp_max(1.0)[:, None]
    # |steepest + t (full - steepest)| = radius, the larger root.
    to_newton = newton_step - steepest
    a, b = (to_newton * to_newton).sum(1).clamp_min(1e-30), (steepest * to_newton).sum(1)
    root = (b * b + a * (radius**2 - steepest_length**2)).clamp_min(0.0).sqrt()
    on_second_leg = steepest + ((root - b) / a).clamp(0.0, 1.0)[:, None] * to_newton
    newton_within = torch.linalg.vector_norm(newton_step, dim=1) <= radius
    path = torch.where((steepest_length < radius)[:, None], on_second_leg, along_gradient)
    return torch.where(newton_within[:, None], newton_step, path) / scale * free
