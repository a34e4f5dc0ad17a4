"""Nonlinear conjugate gradient (Polak-Ribiere, Wolfe line search), the paper's optimiser, batched."""

from __future__ import annotations

from dataclasses import dataclass

import torch

from vig.search.optimizer import Budget
from vig_paper.optimizers.searching import Ended, Searches, held_by_bounds, scales
from vig_paper.optimizers.tensors import TensorProblem, of_tensors

SUFFICIENT_INCREASE = 1e-4
"""First Wolfe condition: least gain, as a share of the gain that the slope predicts."""

SLOPE_SHARE = 0.1
"""Second Wolfe condition: greatest remaining slope, as a share of the slope at the start."""

MAX_EXTRAPOLATION = 3.0
"""Greatest factor by which a line search extends its step."""

MAX_STEP_GROWTH = 10.0
"""Greatest factor from the step of a line search to the first step of the next."""


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

    @of_tensors
    def __call__(
        self, problem: TensorProblem, starts: torch.Tensor, photo: torch.Tensor, sigma: float, budget: Budget
    ) -> Ended:
        """Maximise from starts (B, P'); see `Optimizer`."""
        lines = _LineSearches(problem, starts, photo, sigma)
        unit = 1 / scales(lines.normal.nan_to_num()) if self.scaled else torch.ones_like(lines.points)
        direction, uphill_before = torch.zeros_like(lines.points), torch.zeros_like(lines.points)
        slope, step = torch.ones_like(lines.noise), torch.zeros_like(lines.noise)
        steepest = torch.ones_like(lines.converged)
        for _ in range(budget.iterations):
            active = lines.active
            if not len(active):
                break
            at_bound = held_by_bounds(lines.points[active], lines.gradient[active], problem)
            uphill = torch.where(at_bound, 0.0, lines.gradient[active] * unit[active])
            previous_uphill = uphill_before[active]
            momentum = (uphill * (uphill - previous_uphill)).sum(1) / (previous_uphill * previous_uphill).sum(
                1
            ).clamp_min(1e-30)
            momentum = torch.where(steepest[active], 0.0, momentum.clamp_min(0.0))
            search_direction = torch.where(at_bound, 0.0, uphill + momentum[:, None] * direction[active])
            climbs = ((search_direction * uphill).sum(1) > 0) & torch.isfinite(search_direction).all(1)
            search_direction = torch.where(climbs[:, None], search_direction, uphill)
            steepest[active] |= ~climbs
            initial_slope = (search_direction * uphill).sum(1)
            first_step = step[active] * (slope[active] / initial_slope.clamp_min(1e-30)).clamp_max(
                MAX_STEP_GROWTH
            )
            # Without an earlier step, the first is the one that would gain one nat at a constant slope.
            first_step = torch.where(step[active] > 0, first_step, 1 / (1 + initial_slope))
            gain, step[active] = lines.search(
                active, search_direction * unit[active], first_step, self.evaluations
            )
            direction[active], uphill_before[active], slope[active] = search_direction, uphill, initial_slope
            # A conjugate direction without gain is followed by steepest ascent; if that fails too, the search
            # ends.
            failed = gain <= 0
            done = (initial_slope <= 0) | (failed & steepest[active]) | (~failed & (gain < budget.tolerance))
            steepest[active] = failed
            lines.end(done)
        return lines.descent()


class _LineSearches(Searches):
    """Line searches from the current points of B searches."""

    def search(
        self, active: torch.Tensor, along: torch.Tensor, first_steps: torch.Tensor, limit: int
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """Move searches `active` (A,) to good points of their lines `along` (A, P'): gains and steps (A,).

        first (A,): steps to try first. Along a line clamped to the bounds, a bracket [low, high] of a point
        that meets Wolfe's conditions is widened, then narrowed, by secants and parabolas.
        """
        origin, base = self.points[active], self.value[active].clone()
        uphill = self.gradient[active].clone()
        step, low = first_steps.clone(), torch.zeros_like(first_steps)
        high = torch.full_like(first_steps, torch.inf)
        slope_low, value_low = (along * uphill).sum(1), base.clone()
        value_high = torch.full_like(base, -torch.inf)
        slope, best = slope_low.clone(), torch.zeros_like(first_steps)
        unfinished = torch.arange(len(active), device=origin.device)
        for _ in range(limit):
            if not len(unfinished):
                break
            free_trial = origin[unfinished] + step[unfinished, None] * along[unfinished]
            trial = free_trial.clamp(self.problem.lower, self.problem.upper)
            searches = active[unfinished]
            evaluation = self.evaluate(searches, trial)
            moving = torch.where(trial == free_trial, along[unfinished], 0.0)
            value, slope_now = evaluation[0], (evaluation[1] * moving).sum(1).nan_to_num()
            promised = (uphill[unfinished] * (trial - origin[unfinished])).sum(1)
            sufficient = value >= base[unfinished] + SUFFICIENT_INCREASE * promised
            better = value > self.value[searches]
            self.move(searches, trial, evaluation, better)
            best[unfinished[better]] = step[unfinished[better]]
            is_flat = slope_now.abs() <= SLOPE_SHARE * slope[unfinished]
            past_maximum = ~sufficient | (value < value_low[unfinished]) | (slope_now < 0)
            to_narrow, to_widen = unfinished[past_maximum], unfinished[~past_maximum]
            high[to_narrow], value_high[to_narrow] = step[to_narrow], value[past_maximum]
            step_before, slope_at = step[to_widen].clone(), slope_now[~past_maximum]
            step[to_narrow] = _interpolate(
                low[to_narrow],
                high[to_narrow],
                value_low[to_narrow],
                value_high[to_narrow],
                slope_low[to_narrow],
            )
            step[to_widen] = _extrapolate(
                low[to_widen], high[to_widen], slope_low[to_widen], step_before, slope_at
            )
            low[to_widen], slope_low[to_widen], value_low[to_widen] = (
                step_before,
                slope_at,
                value[~past_maximum],
            )
            bracket_closed = high[unfinished] - low[unfinished] <= 1e-9 * low[unfinished]
            unfinished = unfinished[~((sufficient & is_flat) | bracket_closed)]
        return self.value[active] - base, best


def _interpolate(
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


def _extrapolate(
    low: torch.Tensor, high: torch.Tensor, slope_low: torch.Tensor, step: torch.Tensor, slope: torch.Tensor
) -> torch.Tensor:
    """Where the secant of the slopes at low and step is flat, between the two and the bracket."""
    far = torch.where(torch.isfinite(high), 0.5 * (step + high), MAX_EXTRAPOLATION * step)
    bend = slope_low - slope
    guess = torch.where(bend > 0, step + (step - low) * slope / bend, far)
    return torch.minimum(torch.maximum(guess, step + 0.1 * (far - step)), far)
