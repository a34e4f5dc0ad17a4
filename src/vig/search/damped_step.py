"""Damped steps of Levenberg-Marquardt searches and their acceptance, each of all searches in one launch."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
import warp as wp

from vig.search.optimizer import Problem, Valued
from vig_renderer.device import initialise, kernel_module, launch, native_code, scalar_type
from vig_renderer.once import make_once

ROUNDS = 3
"""How often a step is solved, numbers at a bound held."""
KINDS = {"LAUNCH": 0, "FILL": 1, "CLEAR": 2, "COPY": 3, "COMBINE": 4, "PROJECT": 5, "SQUARE": 6}
"""Of the steps of a valuation by native code; `descend.cc` says what each does."""
STEP_NUMBERS = 6
"""Of such a step: its kind and what it takes."""
LANES = 16
"""Numbers in a padded vector, and pixels taken at a time: whole vector registers of a processor."""
TILE = 8
"""Vectors that a product sums at once; for 16 there are too few registers, and it takes twice as long."""
TABLE = (
    *("steps", "trial", "tried_value", "tried_gradient", "tried_normal"),
    *("point", "value", "gradient", "normal", "damping", "growth", "step", "done"),
    *("starts", "path", "end_value", "end_normal", "evaluations", "converged"),
    *("damped_function", "damped_bounds", "damped_arguments"),
    *("accept_function", "accept_bounds", "accept_arguments"),
    *("step_count", "searches", "size", "iterations", "first", "stride"),
)
"""What `descend.cc` is given, in this order: addresses, then numbers."""


@make_once
def search_kernels(dtype: torch.dtype) -> tuple[Any, Any, Any]:
    """For one scalar type the kernels of a step and of its acceptance, a thread for each search, and that of
    whole searches one after the other, on the processor."""
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

    @wp.func_native(snippet=native_code(Path(__file__).parent, "accept.cc", real=real))
    def accept_one(
        search: wp.int32,
        step: wp.array2d(dtype=real),
        promised: wp.array(dtype=wp.float64),
        tried_value: wp.array(dtype=wp.float64),
        tried_gradient: wp.array2d(dtype=real),
        tried_normal: wp.array3d(dtype=real),
        tolerance: wp.float64,
        give_up: real,
        points: wp.array2d(dtype=real),
        value: wp.array(dtype=wp.float64),
        gradient: wp.array2d(dtype=real),
        normal: wp.array3d(dtype=real),
        damping: wp.array(dtype=real),
        growth: wp.array(dtype=real),
        done: wp.array(dtype=wp.bool),
    ): ...

    @wp.kernel(module=kernel_module("search", dtype))
    def accept(
        step: wp.array2d(dtype=real),
        promised: wp.array(dtype=wp.float64),
        tried_value: wp.array(dtype=wp.float64),
        tried_gradient: wp.array2d(dtype=real),
        tried_normal: wp.array3d(dtype=real),
        tolerance: wp.float64,
        give_up: real,
        points: wp.array2d(dtype=real),
        value: wp.array(dtype=wp.float64),
        gradient: wp.array2d(dtype=real),
        normal: wp.array3d(dtype=real),
        damping: wp.array(dtype=real),
        growth: wp.array(dtype=real),
        done: wp.array(dtype=wp.bool),
    ):
        accept_one(
            wp.tid(),
            step,
            promised,
            tried_value,
            tried_gradient,
            tried_normal,
            tolerance,
            give_up,
            points,
            value,
            gradient,
            normal,
            damping,
            growth,
            done,
        )

    constants = {**KINDS, "STEP_NUMBERS": STEP_NUMBERS, "LANES": LANES, "TILE": TILE}
    constants |= {f"AT_{name.upper()}": place for place, name in enumerate(TABLE)}
    whole = native_code(Path(__file__).parent, "descend.cc", real=real, **constants)

    @wp.func_native(snippet=whole)
    def descend_all(table: wp.array(dtype=wp.int64), first_damping: wp.float64): ...

    @wp.kernel(module=kernel_module("search", dtype))
    def descend(table: wp.array(dtype=wp.int64), first_damping: wp.float64):
        descend_all(table, first_damping)

    return damped, accept, descend


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
    launch(search_kernels(points.dtype)[0], count, *inputs, scratch, held, step, promised)
    return step, promised


@dataclass
class Standing:
    """Where B searches that go on stand.

    Attributes:
        points, gradient: (B, P').
        value: (B,) float64.
        normal: (B, P', P').
        damping: (B,) see `damped_step`.
        growth: (B,) factor by which damping grows when a step fails.
    """

    points: torch.Tensor
    value: torch.Tensor
    gradient: torch.Tensor
    normal: torch.Tensor
    damping: torch.Tensor
    growth: torch.Tensor

    def accept(
        self, step: torch.Tensor, promised: torch.Tensor, tried: Valued, tolerance: float, give_up: float
    ) -> torch.Tensor:
        """Take steps (B, P') that were `tried` and gain, in place; whether searches are done, (B,) bool.

        A search is done that gains less than `tolerance` nats or whose damping is beyond `give_up`.
        """
        done = torch.empty(len(step), dtype=torch.bool, device=step.device)
        assert tried.gradient is not None and tried.normal is not None
        outcome = (
            tried.value.double(),
            *(each.to(step).contiguous() for each in (tried.gradient, tried.normal)),
        )
        bounds = float(tolerance), float(give_up)
        kernel = search_kernels(step.dtype)[1]
        launch(kernel, len(step), step, promised, *outcome, *bounds, *vars(self).values(), done)
        return done
