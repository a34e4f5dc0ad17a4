"""Robust Gauss-Newton with Levenberg-Marquardt damping: the default, in native code (vig_native/search.cc).

The inlier posteriors weigh the normal matrix (iteratively reweighted least squares), the exact gradient
drives it, bounds are met by an active set in the step itself. Damping follows Nielsen (1999).
"""

from dataclasses import dataclass

import numpy as np

from vig.search.optimizer import Budget, Descent, Problem
from vig_native import engine


@dataclass(frozen=True)
class LevenbergMarquardt:
    """Settings.

    Attributes:
        damping: First multiple of the normal matrix's diagonal. 1.0 is surer for a single search from far
            off; where several start, 0.1 ends as well in fewer steps.
        give_up: The damping at which a search ends.
    """

    damping: float = 0.1
    give_up: float = 1e4

    def __call__(
        self, objective: Problem, starts: np.ndarray, photo: np.ndarray, sigma: float, budget: Budget
    ) -> Descent:
        """Maximise from starts (B, P'); see `Optimizer`."""
        native = getattr(objective, "search", None)
        if native is not None and not photo.any() and np.isfinite(starts).all():
            descent: Descent | None = native(starts, sigma, budget, self.damping, self.give_up)
            if descent is not None:
                return descent
        ends = [
            self._search(objective, start[None], np.array([of_photo]), sigma, budget)
            for start, of_photo in zip(starts, photo, strict=True)
        ]
        path, value, normal, evaluations, converged = (
            np.concatenate([end[field] for end in ends], axis=int(field == 0)) for field in range(5)
        )
        path = path[: int(evaluations.max())]
        return Descent(
            path[-1].copy(), value, evaluations, converged, path, normal if budget.iterations else None
        )

    def _search(
        self, objective: Problem, start: np.ndarray, photo: np.ndarray, sigma: float, budget: Budget
    ) -> tuple[np.ndarray, ...]:
        """Return one search (1, P') of a problem in Python: path, value, normal, evaluations, converged."""
        noise = np.full(1, sigma, objective.dtype)

        def value_point(point: np.ndarray, derivatives: bool) -> tuple[object, ...]:
            valued = objective(point[None], photo, noise, derivatives=derivatives)
            if not derivatives:
                return float(valued.value[0]), None, None
            assert valued.gradient is not None and valued.normal is not None
            parts = (np.ascontiguousarray(each[0], start.dtype) for each in (valued.gradient, valued.normal))
            return float(valued.value[0]), *parts

        bounds = (np.ascontiguousarray(each, start.dtype) for each in (objective.lower, objective.upper))
        settings = budget.iterations, budget.tolerance, self.damping, self.give_up
        found: tuple[np.ndarray, ...] = engine.search_function(
            value_point, np.ascontiguousarray(start), *bounds, *settings
        )
        return found
