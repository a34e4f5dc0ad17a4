"""What these maximisers share: batched searches, and steps within bounds."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch

from vig_paper.optimizers.tensors import TensorProblem

ROUNDS = 4
"""How often a step within bounds is solved, at most."""


def held_by_bounds(points: torch.Tensor, gradient: torch.Tensor, problem: TensorProblem) -> torch.Tensor:
    """Parameters (B, P') bool that are fixed or rest on a bound that the gradient (B, P') pushes against."""
    lower, upper = problem.lower, problem.upper
    return ((points <= lower) & (gradient <= 0)) | ((points >= upper) & (gradient >= 0)) | (lower == upper)


def scales(normal: torch.Tensor) -> torch.Tensor:
    """What a parameter is multiplied by to be counted in its own standard deviations: (B, P', P') to (B, P').

    The root of the normal matrix's diagonal, at least a thousandth of the largest: a parameter that nothing
    is known of gets a finite one.
    """
    diagonal = torch.diagonal(normal, dim1=1, dim2=2).clamp_min(0.0)
    root = diagonal.sqrt()
    return root.clamp_min(1e-3 * root.amax(1, keepdim=True)).clamp_min(torch.finfo(root.dtype).tiny)


def bounded_step(
    points: torch.Tensor,
    gradient: torch.Tensor,
    normal: torch.Tensor,
    problem: TensorProblem,
    solve: Callable[[torch.Tensor, torch.Tensor, torch.Tensor], torch.Tensor],
) -> tuple[torch.Tensor, torch.Tensor]:
    """A step within the bounds: numbers that would pass a bound are held on it, the others solved again.

    Args:
        points: (B, P').
        gradient: (B, P') there.
        normal: (B, P', P') there.
        problem: States the bounds.
        solve: From the right side (B, P'), the matrix (B, P', P') and what is free (B, P') bool to the step
            without bounds. Both are zero where nothing is free, but for the matrix's diagonal, which is 1.

    Returns:
        The step (B, P'), and the gain (B,) float64 that the quadratic model promises.
    """
    lower, upper, step = problem.lower, problem.upper, torch.zeros_like(points)
    held = held_by_bounds(points, gradient, problem)
    for _ in range(ROUNDS):
        free = (~held).to(points.dtype)
        matrix = normal * (free[:, :, None] * free[:, None, :])
        torch.diagonal(matrix, dim1=1, dim2=2).add_(held.to(points.dtype))
        right = (gradient - (normal @ (step * held)[:, :, None])[:, :, 0]) * free
        step = torch.where(held, step, solve(right, matrix, ~held))
        reached = points + step
        bounded = reached.clamp(lower, upper)
        over = (bounded != reached) & ~held
        if not over.any():
            break
        step = torch.where(over, bounded - points, step)
        held = held | over
    step = (points + step).clamp(lower, upper) - points
    curved = (normal @ step[:, :, None])[:, :, 0]
    return step, ((gradient - 0.5 * curved) * step).sum(1).double()


def newton(right: torch.Tensor, matrix: torch.Tensor, free: torch.Tensor) -> torch.Tensor:
    """Gauss-Newton step (B, P') for `bounded_step`; where the matrix is singular, the smallest one, scaled.

    Directions whose eigenvalue is lost in rounding, parameters in their own deviations, are left alone.
    """
    scale = scales(matrix)
    values, vectors = torch.linalg.eigh(matrix / (scale[:, :, None] * scale[:, None, :]))
    least = torch.finfo(values.dtype).eps * values.shape[1]
    inverse = torch.where(values > least * values[:, -1:], 1 / values, 0.0)
    along = torch.einsum("bij,bi->bj", vectors, right / scale)
    return torch.einsum("bij,bj->bi", vectors, along * inverse) / scale * free


@dataclass(frozen=True)
class Ended:
    """`vig.search.Descent` in tensors."""

    points: torch.Tensor
    value: torch.Tensor
    evaluations: torch.Tensor
    converged: torch.Tensor


class Searches:
    """State of B batched searches: the best points, and the indices `active` (A,) of unfinished ones."""

    def __init__(self, problem: TensorProblem, starts: torch.Tensor, photo: torch.Tensor, sigma: float):
        self.problem, self.photo, self.points = problem, photo, starts.clone()
        self.noise = torch.full((len(starts),), sigma, dtype=problem.dtype)
        self.evaluations = torch.zeros(len(starts), dtype=torch.int64)
        self.converged = torch.zeros(len(starts), dtype=torch.bool)
        start = self.evaluate(torch.arange(len(starts)), starts)
        self.value, self.gradient, self.normal = (part.clone() for part in start)
        self.active = torch.isfinite(self.value).nonzero()[:, 0]

    def evaluate(
        self, which: torch.Tensor, points: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """Value, gradient and normal matrix at points (A, P') of searches `which` (A,)."""
        self.evaluations[which] += 1
        tried = self.problem(points, self.photo[which], self.noise[which])
        assert tried.gradient is not None and tried.normal is not None
        return tried.value, tried.gradient, tried.normal

    def move(
        self,
        which: torch.Tensor,
        points: torch.Tensor,
        tried: tuple[torch.Tensor, torch.Tensor, torch.Tensor],
        better: torch.Tensor,
    ) -> None:
        """Take the points (A, P') that were tried where they are `better` (A,) bool."""
        taken = which[better]
        self.points[taken] = points[better]
        for held, new in zip((self.value, self.gradient, self.normal), tried, strict=True):
            held[taken] = new[better]

    def end(self, done: torch.Tensor) -> None:
        """Active searches that are done (A,) bool have converged."""
        self.converged[self.active[done]] = True
        self.active = self.active[~done]

    def descent(self) -> Ended:
        """Return the current state as the result."""
        return Ended(self.points, self.value, self.evaluations, self.converged)
