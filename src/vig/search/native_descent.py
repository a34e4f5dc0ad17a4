"""Levenberg-Marquardt searches on the processor in one native call: for problems whose value is native, too.

A search's small products and copies take less time than Python takes to ask for them.
"""

from __future__ import annotations

import threading
from collections.abc import Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import torch

from vig.parallel.threads import run_on_threads, thread_count
from vig.search.damped_step import KINDS, STEP, Standing, search_kernels
from vig.search.optimizer import Budget, Descent, Problem
from vig_renderer.device import Prepared, recorded

LAUNCH, FILL, CLEAR, COPY, COMBINE, PROJECT, SQUARE = KINDS.values()


@dataclass(frozen=True)
class Valuation:
    """How native code values a problem at one point: steps that read and write memory at fixed addresses.

    Attributes:
        point: (P',) contiguous, what is valued.
        value: (1,) float64; gradient (1, P'), normal (1, P', P') as of `Valued`: what the steps write.
        steps: Each a kind of `KINDS` and up to five addresses and numbers.
        kept: What the addresses belong to.
    """

    point: torch.Tensor
    value: torch.Tensor
    gradient: torch.Tensor
    normal: torch.Tensor
    steps: list[tuple[int, ...]]
    kept: tuple[Any, ...] = ()

    def then(self, launch: Prepared) -> Valuation:
        """The same with a launch after it."""
        assert launch.addresses is not None
        steps = [*self.steps, (LAUNCH, *launch.addresses)]
        return Valuation(self.point, self.value, self.gradient, self.normal, steps, (*self.kept, launch))


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

    def run(
        self,
        problem: NativeProblem,
        valuation: Valuation,
        starts: torch.Tensor,
        found: Sequence[torch.Tensor],
        first: int,
        among: int,
        limits: tuple[float, float, float],
    ) -> None:
        """Search from starts `first`, `first + among`, ...

        found: path, value, normal, evaluations and whether converged, of all starts, to be written. limits:
        damping, tolerance, give_up.
        """
        damped, accept, descent = search_kernels(starts.dtype)
        damping, tolerance, give_up = limits
        here, tried = self.here, (valuation.value, valuation.gradient, valuation.normal)
        standing = list(vars(here).values())
        given = here.points, here.gradient, here.normal, here.damping, problem.lower, problem.upper
        launches = (
            recorded(damped, 1, *given, self.scratch, self.held, self.step, self.promised),
            recorded(accept, 1, self.step, self.promised, *tried, tolerance, give_up, *standing, self.done),
        )
        steps = torch.tensor([[*step, *[0] * (STEP - len(step))] for step in valuation.steps])
        memory = [steps, valuation.point, *tried, *standing, self.step, self.done, starts, *found]
        places = [each.data_ptr() for each in memory]
        places += [*(number for launch in launches for number in launch.addresses or ()), len(steps)]
        places += [*starts.shape, len(found[0]) - 1, first, among]
        table = torch.tensor(places)
        recorded(descent, 1, table, damping)()


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
    count, size = starts.shape
    if (
        str(problem.device) != "cpu"
        or not torch.isfinite(starts).all()
        or len(of := set(photo.tolist())) != 1
    ):
        return None
    (number,), starts = of, starts.contiguous()
    path = starts.new_empty(budget.iterations + 1, count, size)
    value, normal = starts.new_empty(count, dtype=torch.float64), starts.new_empty(count, size, size)
    evaluations, converged = torch.empty(count, dtype=torch.int64), torch.empty(count, dtype=torch.bool)
    found = path, value, normal, evaluations, converged
    threads, refused, limits = min(thread_count(), count), list[int](), (damping, budget.tolerance, give_up)

    def every(first: int) -> None:
        kept = _here.__dict__.setdefault("searches", {})
        if (search := kept.get((size, starts.dtype))) is None:
            search = kept[size, starts.dtype] = _Search(size, starts.dtype)
        with problem.valuation(number, sigma, budget.iterations > 0) as valuation:
            if valuation is None:
                refused.append(first)
            else:
                search.run(problem, valuation, starts, found, first, threads, limits)

    run_on_threads(every, threads)
    if refused:
        return None
    path = path[: int(evaluations.max())]
    curvature = normal if budget.iterations else None
    return Descent(path[-1].clone(), value, evaluations, converged, path, curvature)
