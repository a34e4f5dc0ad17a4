"""Forward Jacobians: how whole images change with a few numbers."""

from __future__ import annotations

from collections.abc import Callable

import torch


def jacobian(
    function: Callable[[torch.Tensor], torch.Tensor], latents: torch.Tensor
) -> tuple[torch.Tensor, torch.Tensor]:
    """Value (...) of a function of P numbers, and its Jacobian (..., P), by forward differentiation.

    function: renders, say, from a vector of latents (P,) and returns one tensor. One pass per number: for few
    numbers and many pixels, as in Gauss-Newton. torch.func.jvp gives a single direction.
    """
    if latents.ndim != 1:
        raise ValueError(f"latents must be one vector (P,); got {tuple(latents.shape)}")
    value, columns = function(latents), []
    for direction in torch.eye(len(latents), dtype=latents.dtype, device=latents.device):
        columns.append(torch.func.jvp(function, (latents,), (direction,))[1])
    return value, torch.stack(columns, dim=-1) if columns else value.new_zeros(*value.shape, 0)
