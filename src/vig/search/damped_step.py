"""The damped step of Levenberg-Marquardt searches, all of them in one launch."""

import functools
from pathlib import Path
from typing import Any

import torch
import warp as wp

from vig.renderer.device import initialise, kernel_module, launch, native_code, scalar_type
from vig.search.optimizer import Problem

ROUNDS = 3
"""How often a step is solved, numbers at a bound held."""


@functools.cache
def step_kernel(dtype: torch.dtype) -> Any:
    """The kernel for one scalar type; a thread for each search."""
    initialise()
    real = scalar_type(dtype)

    @wp.func_native(snippet=native_code(Path(__file__).parent, "damped_step.cc", real=real, ROUNDS=ROUNDS))
    def solve(
        search: wp.int32,
        points: wp.array2d(dtype=real),
        gradient: wp.array2d(dtype=real),
        normal: wp.array3d(dtype=real),
        damping: wp.array(dtype=real),
        lower: wp.array(dtype=real),
        upper: wp.array(dtype=real),
        scratch: wp.array3d(dtype=real),
        held: wp.array2d(dtype=wp.uint8),
        step: wp.array2d(dtype=real),
        promised: wp.array(dtype=wp.float64),
    ): ...

    @wp.kernel(module=kernel_module("search", dtype))
    def damped(
        points: wp.array2d(dtype=real),
        gradient: wp.array2d(dtype=real),
        normal: wp.array3d(dtype=real),
        damping: wp.array(dtype=real),
        lower: wp.array(dtype=real),
        upper: wp.array(dtype=real),
        scratch: wp.array3d(dtype=real),
        held: wp.array2d(dtype=wp.uint8),
        step: wp.array2d(dtype=real),
        promised: wp.array(dtype=wp.float64),
    ):
        solve(wp.tid(), points, gradient, normal, damping, lower, upper, scratch, held, step, promised)

    return damped


def damped_step(
    points: torch.Tensor,
    gradient: torch.Tensor,
    normal: torch.Tensor,
    damping: torch.Tensor,
    problem: Problem,
) -> tuple[torch.Tensor, torch.Tensor]:
    """Steps (B, P') within the bounds, and the gain (B,) float64 that the quadratic model promises.

    points, gradient (B, P'), normal (B, P', P'); damping (B,): the multiple of the normal matrix's diagonal
    that is added to it. A matrix that is not positive gives a short step along the scaled gradient.
    """
    count, size = points.shape
    step, promised = points.new_empty(count, size), points.new_empty(count, dtype=torch.float64)
    scratch = points.new_empty(count, size + 2, size)
    held = points.new_empty(count, size, dtype=torch.uint8)
    inputs_of_type = points, gradient, normal, damping, problem.lower, problem.upper
    inputs = [tensor.to(points.dtype).contiguous() for tensor in inputs_of_type]
    launch(step_kernel(points.dtype), count, *inputs, scratch, held, step, promised)
    return step, promised
