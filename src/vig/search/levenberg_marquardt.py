"""Robust Gauss-Newton with Levenberg-Marquardt damping, batched: the default.

The inlier posteriors weigh the normal matrix (iteratively reweighted least squares), the exact gradient
drives it, bounds are met by an active set in the step itself. Damping follows Nielsen (1999).
"""

from __future__ import annotations

from dataclasses import dataclass

import torch

from vig.parallel.threads import on_one_core
from vig.search.damped_step import Standing, damped_step
from vig.search.native_descent import NativeProblem, descend
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
        # What native code does not take, or takes wrong input for, goes on below.
        if isinstance(objective, NativeProblem) and starts.dtype == objective.dtype:
            native = descend(objective, starts, photo, sigma, budget, self.damping, self.give_up)
            if native is not None:
                return native
        noise = torch.full((count,), sigma, dtype=objective.dtype, device=objective.device)
        if not budget.iterations:
            value = objective(starts, photo, noise, derivatives=False).value.double()
            ones = torch.ones(count, dtype=torch.int64, device=objective.device)
            return Descent(starts.clone(), value, ones, ones < 1, starts[None])
        start = objective(starts, photo, noise)
        assert start.gradient is not None and start.normal is not None
        points, value, curvature = starts.clone(), start.value.double().clone(), start.normal.clone()
        evaluations = torch.ones(count, dtype=torch.int64, device=objective.device)
        converged = torch.isfinite(value) & torch.isfinite(start.gradient).all(1)
        # The searches that go on, close together: which they are, and where each stands.
        going = converged.nonzero()[:, 0]
        photo, noise, path = photo[going], noise[going], [starts]
        damping = torch.full((len(going),), self.damping, dtype=objective.dtype, device=objective.device)
        gradient, normal = start.gradient[going].to(starts), start.normal[going].to(starts)
        growth = torch.full_like(damping, 3.0)
        here = Standing(points[going], value[going], gradient, normal, damping, growth)
        for _ in range(budget.iterations):
            if not len(going):
                break
            step, promised = damped_step(here.points, here.gradient, here.normal, here.damping, objective)
            tried = objective(here.points + step, photo, noise)
            done = here.accept(step, promised, tried, budget.tolerance, self.give_up)
            evaluations[going] += 1
            points[going] = here.points
            path.append(points.clone())
            if done.any():
                value[going], curvature[going] = here.value, here.normal
                on = ~done
                going, photo, noise = going[on], photo[on], noise[on]
                here = Standing(*(each[on] for each in vars(here).values()))
        value[going], curvature[going] = here.value, here.normal
        converged[going] = False
        return Descent(points, value, evaluations, converged, torch.stack(path), curvature)
