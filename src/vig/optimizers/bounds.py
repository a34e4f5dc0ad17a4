"""Steps within bounds by an active set, and the scale of a problem's parameters."""

from __future__ import annotations

from collections.abc import Callable

import torch

from vig.optimizers.optimizer import Problem


def held_by_bounds(points: torch.Tensor, gradient: torch.Tensor, problem: Problem) -> torch.Tensor:
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
    problem: Problem,
    solve: Callable[[torch.Tensor, torch.Tensor, torch.Tensor], torch.Tensor],
    damping: torch.Tensor | float = 0.0,
    rounds: int = 4,
) -> tuple[torch.Tensor, torch.Tensor]:
    """A step within the bounds; what would pass a bound rests on it, and the others are solved again.

    Args:
        points: (B, P').
        gradient: (B, P') there.
        normal: (B, P', P') there.
        problem: States the bounds.
        solve: From the right side (B, P'), the matrix (B, P', P') and what is free (B, P') bool to the step
            without bounds. Both are zero where nothing is free, but for the matrix's diagonal, which is 1.
        damping: (B, P') added to the diagonal of what is free.
        rounds: How often the others are solved again, at most, the first time included.

    Returns:
        The step (B, P'), and the gain (B,) float64 that the quadratic model promises.
    """
    lower, upper, step = problem.lower, problem.upper, torch.zeros_like(points)
    held = held_by_bounds(points, gradient, problem)
    for _ in range(rounds):
        free = (~held).to(points.dtype)
        matrix = normal * (free[:, :, None] * free[:, None, :])
        torch.diagonal(matrix, dim1=1, dim2=2).add_(torch.where(held, 1.0, damping))
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
