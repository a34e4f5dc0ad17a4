"""Steps that meet bounds by themselves, and the scale of a problem's parameters."""

from __future__ import annotations

from collections.abc import Callable

import torch

from vig.optimizers.optimizer import Problem

ROUNDS = 4
"""How often a step is solved again with the parameters that would pass a bound resting on it."""


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
    held: torch.Tensor,
    solve: Callable[[torch.Tensor, torch.Tensor, torch.Tensor], torch.Tensor],
) -> tuple[torch.Tensor, torch.Tensor]:
    """A step (B, P') within the bounds, and the gain that the quadratic model promises (B,).

    solve(right (B, P'), matrix (B, P', P'), free (B, P') bool) is the step without bounds, 0 where it is not
    free; right and matrix are zero there, but for the matrix's diagonal, which is 1. `held` (B, P') do not
    move. What would pass a bound rests on it, and the others are solved again.
    """
    lower, upper = problem.lower, problem.upper
    step = torch.zeros_like(points)
    for _ in range(ROUNDS):
        free = ~held
        number = free.to(points.dtype)
        matrix = normal * number[:, :, None] * number[:, None, :] + torch.diag_embed(1 - number)
        right = (gradient - torch.einsum("bij,bj->bi", normal, step * held)) * number
        step = torch.where(held, step, solve(right, matrix, free))
        over = ((points + step < lower) | (points + step > upper)) & free
        if not over.any():
            break
        step = torch.where(over, (points + step).clamp(lower, upper) - points, step)
        held = held | over
    step = (points + step).clamp(lower, upper) - points
    gain = (gradient * step).sum(1) - 0.5 * torch.einsum("bi,bij,bj->b", step, normal, step)
    return step, gain


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
