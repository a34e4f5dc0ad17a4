"""Optimisers that are written in torch, for problems of arrays."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch

from vig.search.optimizer import Budget, Descent, Problem


@dataclass(frozen=True)
class TensorValue:
    """Tensors of `vig.search.optimizer.Valued`."""

    value: torch.Tensor
    gradient: torch.Tensor | None
    normal: torch.Tensor | None


class TensorProblem:
    """A `vig.search.Problem` over tensors."""

    def __init__(self, problem: Problem):
        self.problem = problem
        self.lower, self.upper = (torch.from_numpy(np.array(each)) for each in (problem.lower, problem.upper))
        self.dtype = self.lower.dtype

    def __call__(
        self, points: torch.Tensor, photo: torch.Tensor, sigma: torch.Tensor, derivatives: bool = True
    ) -> TensorValue:
        """Value points (B, P')."""
        at, of, noise = (each.contiguous().numpy() for each in (points, photo, sigma))
        valued = self.problem(at, of, noise, derivatives)
        parts = valued.value, valued.gradient, valued.normal
        return TensorValue(*(None if each is None else torch.from_numpy(each) for each in parts))  # type: ignore[arg-type]


def of_tensors(search: Callable[..., Any]) -> Callable[..., Descent]:
    """An `Optimizer`'s call from one that takes a `TensorProblem` and tensors, and returns such a descent."""

    @functools.wraps(search)
    def within(
        self: Any, problem: Problem, starts: np.ndarray, photo: np.ndarray, sigma: float, budget: Budget
    ) -> Descent:
        given = (torch.from_numpy(np.ascontiguousarray(each)) for each in (starts, photo))
        found = search(self, TensorProblem(problem), *given, sigma, budget)
        return Descent(
            *(each.numpy() for each in (found.points, found.value, found.evaluations, found.converged))
        )

    return within
