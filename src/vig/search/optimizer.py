"""The arguments and results of every optimiser."""

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np


@dataclass(frozen=True)
class Evaluation:
    """A function at B points of P' numbers each. Results that were not requested are None.

    Attributes:
        value: (B,) float64, NaN or -inf where there is none; of a likelihood and an objective in nats.
        gradient: (B, P') its derivative.
        normal: (B, P', P') its negative Gauss-Newton Hessian.
        posterior: (B, H, W) of a covered pixel being visible, where the points explain photos.
        coverage: (B, H, W) of the silhouette, in [0, 1].
        irradiance: (B, H, W); the rendered colour is albedo times this.
    """

    value: np.ndarray
    gradient: np.ndarray | None = None
    normal: np.ndarray | None = None
    posterior: np.ndarray | None = None
    coverage: np.ndarray | None = None
    irradiance: np.ndarray | None = None


class Problem(Protocol):
    """A function to be maximised over points (B, P') with lower <= point <= upper, (P',) each.

    `vig.inference.Objective` is one: optimisers depend on nothing else of photos.
    """

    lower: np.ndarray
    upper: np.ndarray
    dtype: Any

    def __call__(
        self, points: np.ndarray, photo: np.ndarray, sigma: np.ndarray, derivatives: bool = True
    ) -> Evaluation:
        """Evaluate points (B, P') within the bounds, of photos (B,) int, under noise sigma (B,)."""
        ...


@dataclass(frozen=True)
class Budget:
    """When a search ends at the latest.

    Attributes:
        iterations: Steps at most, tried or taken; line searches, where there are any.
        tolerance: Nats; a search has converged when a step that was taken gains less.
        curvature: Whether the normal matrix at the end is needed.
    """

    iterations: int = 30
    tolerance: float = 0.1
    curvature: bool = True

    def __post_init__(self) -> None:
        if self.iterations < 0 or not self.tolerance >= 0:
            raise ValueError(f"a budget's numbers must not be negative; got {self}")


@dataclass(frozen=True)
class Descent:
    """End points of B searches.

    Attributes:
        points: (B, P'), the best of all points that a search evaluated.
        value: (B,) float64, the objective there; higher is better.
        evaluations: (B,) int, of the objective by each search.
        converged: (B,) bool, it stopped because nothing was gained, not because its budget ended.
        path: (T, B, P') the starts, then the best points after each step; None where these were not kept.
        normal: (B, P', P') the negative Gauss-Newton Hessian at the points; None if not kept, without
            iterations, when starts are only compared, and where it is not needed.
    """

    points: np.ndarray
    value: np.ndarray
    evaluations: np.ndarray
    converged: np.ndarray
    path: np.ndarray | None = None
    normal: np.ndarray | None = None


class Optimizer(Protocol):
    """Maximises a problem from B starts within its bounds."""

    def __call__(
        self, problem: Problem, starts: np.ndarray, photo: np.ndarray, sigma: float, budget: Budget, /
    ) -> Descent:
        """Maximise from starts (B, P') within the bounds; photo (B,) int; sigma: the noise's deviation.

        A search that begins where the problem has no finite value ends there, not converged.
        """
        ...
