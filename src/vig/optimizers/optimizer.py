"""What every optimiser is given and returns."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import torch


class Valued(Protocol):
    """An objective at B points; gradient and normal are None where they were not asked for."""

    @property
    def value(self) -> torch.Tensor:
        """(B,) float64, NaN or -inf where there is none."""

    @property
    def gradient(self) -> torch.Tensor | None:
        """(B, P')."""

    @property
    def normal(self) -> torch.Tensor | None:
        """(B, P', P'), the negative Gauss-Newton Hessian."""


class Problem(Protocol):
    """A function to be maximised over points (B, P') with lower <= point <= upper, (P',) each.

    `vig.inference.Objective` is one: optimisers know nothing else of photos.
    """

    lower: torch.Tensor
    upper: torch.Tensor
    dtype: torch.dtype
    device: str

    def __call__(
        self, points: torch.Tensor, photo: torch.Tensor, sigma: torch.Tensor, derivatives: bool = True
    ) -> Valued:
        """Value points (B, P') within the bounds, of photos (B,) int, under noise sigma (B,)."""
        ...


@dataclass(frozen=True)
class Budget:
    """When a search ends at the latest.

    Attributes:
        iterations: Steps at most, tried or taken; line searches, where there are any.
        tolerance: Nats; a search has converged when a step that was taken gains less.
    """

    iterations: int = 30
    tolerance: float = 0.1

    def __post_init__(self) -> None:
        if self.iterations < 0 or not self.tolerance >= 0:
            raise ValueError(f"a budget's numbers must not be negative; got {self}")


@dataclass(frozen=True)
class Descent:
    """Where B searches ended.

    Attributes:
        points: (B, P'), the best of all points that a search evaluated.
        value: (B,) float64, the objective there; higher is better.
        evaluations: (B,) int, of the objective by each search.
        converged: (B,) bool, it stopped because nothing was gained, not because its budget ended.
    """

    points: torch.Tensor
    value: torch.Tensor
    evaluations: torch.Tensor
    converged: torch.Tensor


class Optimizer(Protocol):
    """Maximises a problem from B starts within its bounds."""

    def __call__(
        self, problem: Problem, starts: torch.Tensor, photo: torch.Tensor, sigma: float, budget: Budget, /
    ) -> Descent:
        """starts (B, P') within the bounds, left alone; photo (B,) int; sigma: the noise's deviation.

        A search that begins where the problem has no finite value ends there, not converged.
        """
        ...


class Searches:
    """B batched searches under way: where each stands, and which are `active` (A,), indices."""

    def __init__(self, problem: Problem, starts: torch.Tensor, photo: torch.Tensor, sigma: float):
        self.problem, self.photo, self.points = problem, photo, starts.clone()
        self.noise = torch.full((len(starts),), sigma, dtype=problem.dtype, device=problem.device)
        self.evaluations = torch.zeros(len(starts), dtype=torch.int64, device=problem.device)
        self.converged = torch.zeros(len(starts), dtype=torch.bool, device=problem.device)
        start = self.evaluate(torch.arange(len(starts), device=problem.device), starts)
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

    def descent(self) -> Descent:
        """Where they stand."""
        return Descent(self.points, self.value, self.evaluations, self.converged)
