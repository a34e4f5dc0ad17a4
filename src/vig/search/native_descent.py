"""Whole Levenberg-Marquardt searches in one native call: on the processor, of what native code can value.

Python would take longer to ask for the small products and copies of a search than they take.
"""

from __future__ import annotations

import threading
from collections.abc import Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from typing import Any, Protocol, runtime_checkable

import torch
import warp as wp

from vig.parallel.threads import run_on_threads, thread_count
from vig.search.damped_step import KINDS, STEP_NUMBERS, TABLE, Standing, search_kernels
from vig.search.optimizer import Budget, Descent, Problem
from vig_renderer.device import Prepared, recorded
from vig_renderer.once import make_once

LAUNCH, FILL, CLEAR, COPY, COMBINE, PROJECT, SQUARE = KINDS.values()


@dataclass(frozen=True)
class Valuation:
    """How native code values a problem at one point: steps that read and write memory at fixed addresses.

    Attributes:
        point: (P',) contiguous, what is valued.
        value: (1,) float64; gradient (1, P'), normal (1, P', P') as of `Valued`: what the steps write.
        steps: Each a kind of `KINDS` and up to five addresses and numbers.
        launches: Where further launches are kept, by its owner.
    """

    point: torch.Tensor
    value: torch.Tensor
    gradient: torch.Tensor
    normal: torch.Tensor
    steps: list[tuple[int, ...]]
    launches: dict[Any, Prepared]

    def then(self, kernel: Any, *arguments: Any) -> Valuation:
        """The same with a launch of one thread of a kernel after it."""
        launch = recorded(self.launches, kernel, 1, *arguments)
        assert launch.addresses is not None
        return replace(self, steps=[*self.steps, (LAUNCH, *launch.addresses)])


@runtime_checkable
class NativeProblem(Problem, Protocol):
    """A problem that native code may be able to value, on the processor."""

    def valuation(
        self, photo: int, sigma: float, derivatives: bool = True
    ) -> AbstractContextManager[Valuation | None]:
        """How it is valued, for one thread at a time; None where it cannot be in native code."""
        ...


class _Search:
    """What one thread's searches of points (P',) stand on, and the launches of their steps."""

    def __init__(self, size: int, dtype: torch.dtype):
        point, gradient, self.step = (torch.zeros(1, size, dtype=dtype) for _ in range(3))
        value, self.promised = torch.zeros(2, 1, dtype=torch.float64)
        damping, growth = torch.zeros(2, 1, dtype=dtype)
        self.here = Standing(point, value, gradient, torch.zeros(1, size, size, dtype=dtype), damping, growth)
        self.scratch = torch.zeros(1, size + 2, size, dtype=dtype)
        self.held, self.done = torch.zeros(1, size, dtype=torch.uint8), torch.zeros(1, dtype=torch.bool)
        self.launches: dict[Any, Prepared] = {}

    def run(
        self,
        problem: NativeProblem,
        valuation: Valuation,
        starts: torch.Tensor,
        ends: Sequence[torch.Tensor],
        first: int,
        stride: int,
        limits: tuple[float, float, float],
    ) -> None:
        """Search from every `stride`-th start from the `first` on.

        ends: path, value, normal, evaluations and whether converged, of all starts, to be written. limits:
        damping, tolerance, give_up.
        """
        damped_kernel, accept_kernel, descent_kernel = search_kernels(starts.dtype)
        damping, tolerance, give_up = limits
        here, tried = self.here, (valuation.value, valuation.gradient, valuation.normal)
        bounds, size = (problem.lower, problem.upper), starts.shape[1]
        assert {bound.shape for bound in bounds} == {(size,)} and valuation.point.numel() == size
        assert valuation.gradient.shape == (1, size) and valuation.normal.shape == (1, size, size)
        standing = list(vars(here).values())
        model = here.points, here.gradient, here.normal, here.damping, *bounds
        work = self.scratch, self.held, self.step, self.promised
        damped = recorded(self.launches, damped_kernel, 1, *model, *work)
        trial = self.step, self.promised, *tried, tolerance, give_up
        accept = recorded(self.launches, accept_kernel, 1, *trial, *standing, self.done)
        steps = torch.tensor([[*step, *[0] * (STEP_NUMBERS - len(step))] for step in valuation.steps])
        memory = [steps, valuation.point, *tried, *standing, self.step, self.done, starts, *ends]
        table = [tensor.data_ptr() for tensor in memory]
        table += [*(damped.addresses or ()), *(accept.addresses or ())]
        table += [len(steps), *starts.shape, len(ends[0]) - 1, first, stride]
        assert len(table) == len(TABLE)
        numbers = torch.tensor(table)
        recorded(self.launches, descent_kernel, 1, numbers, damping)()


@make_once
def _load(dtype: torch.dtype) -> None:
    wp.force_load("cpu", modules=[search_kernels(dtype)[2].module])


_here = threading.local()


def descend(
    problem: NativeProblem,
    starts: torch.Tensor,
    photo: torch.Tensor,
    sigma: float,
    budget: Budget,
    damping: float,
    give_up: float,
) -> Descent | None:
    """Search from starts (S, P') of photos (S,), shared out to threads.

    None where native code cannot value the problem, or the starts are of different photos. Without iterations
    the starts are only valued.
    """
    if str(problem.device) != "cpu" or starts.ndim != 2 or starts.shape[1:] != problem.lower.shape:
        return None
    count, size = starts.shape
    if photo.shape != (count,) or photo.dtype not in (torch.int32, torch.int64):
        return None
    if not starts.isfinite().all() or len(photos := set(photo.tolist())) != 1:
        return None
    (number,), starts = photos, starts.contiguous()
    path = starts.new_empty(budget.iterations + 1, count, size)
    value, normal = starts.new_empty(count, dtype=torch.float64), starts.new_empty(count, size, size)
    evaluations, converged = torch.empty(count, dtype=torch.int64), torch.empty(count, dtype=torch.bool)
    ends = path, value, normal, evaluations, converged
    threads, refused, limits = min(thread_count(), count), list[int](), (damping, budget.tolerance, give_up)
    _load(starts.dtype)

    def search_share(first: int) -> None:
        searches = _here.__dict__.setdefault("searches", {})
        if (search := searches.get((size, starts.dtype))) is None:
            search = searches[size, starts.dtype] = _Search(size, starts.dtype)
        with problem.valuation(number, sigma, budget.iterations > 0) as valuation:
            if valuation is None:
                refused.append(first)
            else:
                search.run(problem, valuation, starts, ends, first, threads, limits)

    run_on_threads(search_share, threads)
    if refused:
        return None
    path = path[: int(evaluations.max())]
    curvature = normal if budget.iterations else None
    return Descent(path[-1].clone(), value, evaluations, converged, path, curvature)
