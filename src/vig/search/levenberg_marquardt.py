"""Robust Gauss-Newton with Levenberg-Marquardt damping, batched: the default.

The inlier posteriors weigh the normal matrix (iteratively reweighted least squares), the exact gradient
drives it, bounds are met by an active set in the step itself. Damping follows Nielsen (1999).
"""

from __future__ import annotations

from dataclasses import dataclass

import torch

from vig.parallel.threads import on_one_core
from vig.search.damped_step import damped_step
from vig.search.optimizer import Budget, Descent, Problem


@dataclass(frozen=True)
class LevenbergMarquardt:
    """Settings.

    Attributes:
        damping: First multiple of the normal matrix's diagonal. 1.0 is surer for a single search from far
            off; where several start, 0.1 ends as well in fewer steps.
        give_up: The damping at which a search ends.
    """

    damping: float = 0.1
    give_up: float = 1e4

    def __call__(
        self, objective: Problem, starts: torch.Tensor, photo: torch.Tensor, sigma: float, budget: Budget
    ) -> Descent:
        """Maximise from starts (B, P'); see `Optimizer`."""
        return on_one_core(lambda: self._search(objective, starts, photo, sigma, budget))

    def _search(
        self, objective: Problem, starts: torch.Tensor, photo: torch.Tensor, sigma: float, budget: Budget
    ) -> Descent:
        count = len(starts)
        noise = torch.full((count,), sigma, dtype=objective.dtype, device=objective.device)
        start = objective(starts, photo, noise)
        assert start.gradient is not None and start.normal is not None
        points, value, curvature = starts.clone(), start.value.clone(), start.normal.clone()
        evaluations = torch.ones(count, dtype=torch.int64, device=objective.device)
        converged = torch.isfinite(value) & torch.isfinite(start.gradient).all(1)
        # The searches that go on, close together: which they are, and where each stands.
        going = converged.nonzero()[:, 0]
        here, best, photo, noise = points[going], value[going], photo[going], noise[going]
        gradient, normal = start.gradient[going], start.normal[going]
        damping = torch.full((len(going),), self.damping, dtype=objective.dtype, device=objective.device)
        growth, path = torch.full_like(damping, 3.0), [starts]
        for _ in range(budget.iterations):
            if not len(going):
                break
            step, predicted = damped_step(here, gradient, normal, damping, objective)
            trial = here + step
            tried = objective(trial, photo, noise)
            assert tried.gradient is not None and tried.normal is not None
            evaluations[going] += 1
            gain = tried.value - best
            better = (gain > 0) & torch.isfinite(tried.gradient).all(1)
            # How far the quadratic model held: 1 where the objective is quadratic.
            ratio = (gain / predicted.clamp_min(1e-9)).to(damping.dtype)
            # Nielsen: shrink smoothly with the gain ratio, grow ever faster while steps fail.
            shrink = (1 - (2 * ratio - 1) ** 3).clamp(1 / 3, 2.0)
            damping = (damping * torch.where(better, shrink, growth)).clamp_min(1e-7)
            # Each failure in a row doubles the factor by which damping grows.
            growth = torch.where(better, 3.0, growth * 2)
            here = torch.where(better[:, None], trial, here)
            best = torch.where(better, tried.value, best)
            points[going], value[going] = here, best
            path.append(points.clone())
            gradient = torch.where(better[:, None], tried.gradient, gradient)
            normal = torch.where(better[:, None, None], tried.normal, normal)
            curvature[going] = normal
            done = (better & (gain < budget.tolerance)) | (damping > self.give_up)
            # A step that promises almost nothing need not be tried.
            done |= predicted < 0.1 * budget.tolerance
            if done.any():
                on = ~done
                going, here, best, photo, noise = going[on], here[on], best[on], photo[on], noise[on]
                gradient, normal, damping, growth = gradient[on], normal[on], damping[on], growth[on]
        converged[going] = False
        return Descent(points, value, evaluations, converged, torch.stack(path), curvature)
