"""Nonlinear conjugate gradient (Polak-Ribiere, Wolfe line search), the paper's optimiser, batched."""

from __future__ import annotations

from dataclasses import dataclass

import torch

from vig.search.optimizer import Budget, Descent, Problem, Searches, held_by_bounds, scales

SUFFICIENT, CURVATURE = 1e-4, 0.1
"""Wolfe's conditions: share of the promised gain, and of the slope that may be left."""

EXTRAPOLATION, GROWTH = 3.0, 10.0
"""Largest factors of a line search's extrapolation, and of the next one's first step."""


@dataclass(frozen=True)
class ConjugateGradient:
    """Settings. The budget's iterations are line searches; a line that meets a bound continues along it.

    The paper's budget is 50 line searches of 20 evaluations, unscaled.

    Attributes:
        evaluations: Of each line search, at most.
        scaled: Each parameter counts in its own standard deviations at the start (`scales`).
    """

    evaluations: int = 20
    scaled: bool = True

    def __call__(
        self, problem: Problem, starts: torch.Tensor, photo: torch.Tensor, sigma: float, budget: Budget
    ) -> Descent:
        """Maximise from starts (B, P'); see `Optimizer`."""
        line = _Lines(problem, starts, photo, sigma)
        unit = 1 / scales(line.normal.nan_to_num()) if self.scaled else torch.ones_like(line.points)
        direction, before = torch.zeros_like(line.points), torch.zeros_like(line.points)
        slope, step = torch.ones_like(line.noise), torch.zeros_like(line.noise)
        steepest = torch.ones_like(line.converged)
        for _ in range(budget.iterations):
            active = line.active
            if not len(active):
                break
            held = held_by_bounds(line.points[active], line.gradient[active], problem)
            uphill = torch.where(held, 0.0, line.gradient[active] * unit[active])
            last = before[active]
            turned = (uphill * (uphill - last)).sum(1) / (last * last).sum(1).clamp_min(1e-30)
            turned = torch.where(steepest[active], 0.0, turned.clamp_min(0.0))
            along = torch.where(held, 0.0, uphill + turned[:, None] * direction[active])
            climbs = ((along * uphill).sum(1) > 0) & torch.isfinite(along).all(1)
            along = torch.where(climbs[:, None], along, uphill)
            steepest[active] |= ~climbs
            rise = (along * uphill).sum(1)
            first = step[active] * (slope[active] / rise.clamp_min(1e-30)).clamp_max(GROWTH)
            # Without a step to go by, the first gains one nat if the slope stays.
            first = torch.where(step[active] > 0, first, 1 / (1 + rise))
            gain, step[active] = line.search(active, along * unit[active], first, self.evaluations)
            direction[active], before[active], slope[active] = along, uphill, rise
            # A direction that leads nowhere is followed by the steepest, and that by nothing.
            failed = gain <= 0
            done = (rise <= 0) | (failed & steepest[active]) | (~failed & (gain < budget.tolerance))
            steepest[active] = failed
            line.end(done)
        return line.descent()


class _Lines(Searches):
    """Line searches from the current points of B searches."""

    def search(
        self, active: torch.Tensor, along: torch.Tensor, first: torch.Tensor, limit: int
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """Move searches `active` (A,) to good points of their lines `along` (A, P'): gains and steps (A,).

        first (A,): steps to try first. Along a line clamped to the bounds, a bracket [low, high] of a point
        that meets Wolfe's conditions is widened, then narrowed, by secants and parabolas.
        """
        origin, base = self.points[active], self.value[active].clone()
        uphill = self.gradient[active].clone()
        step, low = first.clone(), torch.zeros_like(first)
        high = torch.full_like(first, torch.inf)
        slope_low, value_low = (along * uphill).sum(1), base.clone()
        value_high = torch.full_like(base, -torch.inf)
        slope, best = slope_low.clone(), torch.zeros_like(first)
        going = torch.arange(len(active), device=origin.device)
        for _ in range(limit):
            if not len(going):
                break
            free_trial = origin[going] + step[going, None] * along[going]
            trial = free_trial.clamp(self.problem.lower, self.problem.upper)
            which = active[going]
            tried = self.evaluate(which, trial)
            moving = torch.where(trial == free_trial, along[going], 0.0)
            value, now = tried[0], (tried[1] * moving).sum(1).nan_to_num()
            promised = (uphill[going] * (trial - origin[going])).sum(1)
            enough = value >= base[going] + SUFFICIENT * promised
            better = value > self.value[which]
            self.move(which, trial, tried, better)
            best[going[better]] = step[going[better]]
            flat = now.abs() <= CURVATURE * slope[going]
            beyond = ~enough | (value < value_low[going]) | (now < 0)
            nearer, farther = going[beyond], going[~beyond]
            high[nearer], value_high[nearer] = step[nearer], value[beyond]
            at, slope_at = step[farther].clone(), now[~beyond]
            step[nearer] = _inside(
                low[nearer], high[nearer], value_low[nearer], value_high[nearer], slope_low[nearer]
            )
            step[farther] = _outside(low[farther], high[farther], slope_low[farther], at, slope_at)
            low[farther], slope_low[farther], value_low[farther] = at, slope_at, value[~beyond]
            narrow = high[going] - low[going] <= 1e-9 * low[going]
            going = going[~((enough & flat) | narrow)]
        return self.value[active] - base, best


def _inside(
    low: torch.Tensor,
    high: torch.Tensor,
    value_low: torch.Tensor,
    value_high: torch.Tensor,
    slope: torch.Tensor,
) -> torch.Tensor:
    """Top of the parabola through low's value and slope and high's value, well within the bracket."""
    width = high - low
    bend = value_low + slope * width - value_high
    share = (0.5 * slope * width / bend.clamp_min(1e-30)).nan_to_num(nan=0.5)
    return low + width * share.to(width.dtype).clamp(0.1, 0.9)


def _outside(
    low: torch.Tensor, high: torch.Tensor, slope_low: torch.Tensor, step: torch.Tensor, slope: torch.Tensor
) -> torch.Tensor:
    """Where the secant of the slopes at low and step is flat, between the two and the bracket."""
    far = torch.where(torch.isfinite(high), 0.5 * (step + high), EXTRAPOLATION * step)
    bend = slope_low - slope
    guess = torch.where(bend > 0, step + (step - low) * slope / bend, far)
    return torch.minimum(torch.maximum(guess, step + 0.1 * (far - step)), far)
