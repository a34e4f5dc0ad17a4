"""Other maximisers behind the protocol of `vig.search.Optimizer`, to compare Levenberg-Marquardt with.

All but gradient descent are scipy's, which has none. scipy minimises from one start, in most methods without
bounds and without a limit of evaluations: `_Search` adds these, and keeps the best point. Parameters are
counted in their own standard deviations at the start (`_scales`), so that the first step of a method that
knows no curvature yet has a sensible length.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np
import scipy  # which loads `optimize` where that is first used

from vig.search.optimizer import Budget, Descent, Problem


class _OneByOne(ABC):
    """An `Optimizer` that runs one search after the other."""

    per_step: ClassVar[int] = 20
    """Evaluations that a search may take for each iteration of its budget; then it ends."""

    def __call__(
        self, problem: Problem, starts: np.ndarray, photo: np.ndarray, sigma: float, budget: Budget
    ) -> Descent:
        """Maximise from starts (B, P'); see `Optimizer`."""
        searches = []
        for start, of_photo in zip(starts, photo, strict=True):
            search = _Search(problem, start, int(of_photo), sigma, budget)
            search.limit = 1 + self.per_step * budget.iterations
            if np.isfinite(search.best.value) and budget.iterations:
                try:
                    self.run(search)
                except _SpentError:
                    search.converged = False
            searches.append(search)
        return Descent(
            np.stack([search.best.point for search in searches]),
            np.array([search.best.value for search in searches]),
            np.array([search.evaluations for search in searches]),
            np.array([search.converged for search in searches]),
        )

    @abstractmethod
    def run(self, search: _Search) -> None:
        """Run one search."""


@dataclass(frozen=True)
class GradientDescent(_OneByOne):
    """Gradient descent with momentum and decay.

    A step that loses is undone, its momentum dropped and the rate halved; each that gains brings a tenth of
    the rate back, up to `rate`.

    Attributes:
        rate: Length of a step, in standard deviations: 1 would be Newton's step for independent parameters.
        momentum: Share of the last step that is taken again; 0 for none.
        decay: Step number k is taken at rate / (1 + decay k).
    """

    rate: float = 0.1
    momentum: float = 0.9
    decay: float = 0.0

    per_step = 1

    def run(self, search: _Search) -> None:
        """Run one search."""
        scale, rate, velocity = _scales(search.best.normal), self.rate, np.zeros_like(search.best.point)
        value_before = search.best.value
        for number in range(search.budget.iterations):
            here = search.best
            step = rate / (1 + self.decay * number) * here.gradient / scale**2
            tried = search.evaluate(here.point + self.momentum * velocity + step)
            if tried.value >= here.value:
                search.best = tried
                # The velocity is the step after clamping: a parameter at its bound keeps no momentum.
                velocity, rate = tried.point - here.point, min(1.1 * rate, self.rate)
            else:
                velocity, rate = np.zeros_like(velocity), rate / 2
            search.converged = rate < 1e-9 * self.rate
            if (number + 1) % 10 == 0:  # the gain of ten steps: that of one is small
                search.converged |= search.best.value - value_before < search.budget.tolerance
                value_before = search.best.value
            if search.converged:
                break


@dataclass(frozen=True)
class ConjugateGradient(_OneByOne):
    """Nonlinear conjugate gradient (Polak-Ribiere, Wolfe line search), the paper's optimiser.

    The paper's budget is 50 line searches of 20 evaluations, unscaled.

    Attributes:
        evaluations: Evaluations of a line search, in the mean at most.
        scaled: Whether each parameter counts in its own standard deviations.
    """

    evaluations: int = 20
    scaled: bool = True

    def run(self, search: _Search) -> None:
        """Run one search."""
        search.limit = 1 + self.evaluations * search.budget.iterations
        search.minimise("CG", scaled=self.scaled)


@dataclass(frozen=True)
class BFGS(_OneByOne):
    """BFGS, over the parameters that no bound holds."""

    def run(self, search: _Search) -> None:
        """Run one search."""
        search.minimise("BFGS")


@dataclass(frozen=True)
class LBFGS(_OneByOne):
    """L-BFGS with bounds (Byrd, Lu, Nocedal and Zhu's L-BFGS-B).

    Attributes:
        memory: Steps back from which the curvature is estimated.
    """

    memory: int = 20

    def run(self, search: _Search) -> None:
        """Run one search."""
        search.minimise("L-BFGS-B", maxcor=self.memory, maxls=20, ftol=0.0)


@dataclass(frozen=True)
class Dogleg(_OneByOne):
    """Powell's dogleg: Gauss-Newton within a trust region.

    Attributes:
        radius: Radius of the first trust region, in standard deviations.
    """

    radius: float = 10.0

    per_step = 1

    def run(self, search: _Search) -> None:
        """Run one search."""
        search.minimise("dogleg", initial_trust_radius=self.radius, max_trust_radius=1e6, eta=0.0)


class _Evaluated(NamedTuple):
    """A point (P',), its value, the gradient (P',) and the negative Gauss-Newton Hessian (P', P') there."""

    point: np.ndarray
    value: float
    gradient: np.ndarray
    normal: np.ndarray


class _SpentError(Exception):
    """The evaluations are spent."""


class _Search:
    """One search of a photo from a start (P',): evaluation, best point, and stopping."""

    def __init__(self, problem: Problem, start: np.ndarray, photo: int, sigma: float, budget: Budget) -> None:
        self.problem, self.budget = problem, budget
        self.photo, self.noise = np.array([photo]), np.full(1, sigma, problem.dtype)
        self.limit = 1
        self.evaluations, self.steps, self.without_gain, self.converged = 0, 0, 0, False
        self.known: tuple[_Evaluated, ...] = ()
        self.best = self.evaluate(start)
        self.value_before = self.worst = self.best.value

    def evaluate(self, wanted: np.ndarray) -> _Evaluated:
        """Value the point within the bounds that is nearest to one (P',)."""
        point = wanted.clip(self.problem.lower, self.problem.upper).astype(self.problem.dtype)
        for known in self.known:  # scipy asks again where it begins anew
            if np.array_equal(known.point, point):
                return known
        if self.evaluations >= self.limit:
            raise _SpentError
        self.evaluations += 1
        valued = self.problem(point[None], self.photo, self.noise)
        assert valued.gradient is not None and valued.normal is not None
        parts = (part[0].astype(np.float64) for part in (valued.gradient, valued.normal))
        last = _Evaluated(point, float(valued.value[0]), *parts)
        if self.evaluations == 1 or last.value > self.best.value:
            self.best = last
        self.known = self.best, last
        return last

    def minimise(self, method: str, scaled: bool = True, **options: Any) -> None:
        """Run one of scipy's methods on the parameters that no bound holds.

        A method without bounds runs again from where it ended with the parameters that are free there, until
        a run gains less than the tolerance.
        """
        scale = _scales(self.best.normal) if scaled else np.ones(len(self.best.point))
        bounded = method == "L-BFGS-B"
        while self.steps < self.budget.iterations:
            origin, value_before, steps_before = self.best.point, self.best.value, self.steps
            lower, upper = self.problem.lower, self.problem.upper
            free = lower < upper if bounded else ~_fixed_parameters(self.best, self.problem)
            self.converged = not free.any()
            if self.converged:
                return
            bounds = scipy.optimize.Bounds(((lower - origin) * scale)[free], ((upper - origin) * scale)[free])
            options |= {"maxiter": self.budget.iterations - self.steps, "gtol": 1e-12}
            outcome = scipy.optimize.minimize(
                self._negative,
                np.zeros(free.sum()),
                (origin, free, scale),
                method,
                jac=True,
                hess=self._curvature if method == "dogleg" else None,
                bounds=bounds if bounded else None,
                callback=self._after_step,
                options=options,
            )
            if bounded:
                # 0: the gradient vanished; 2: no point of the line is better. Nothing is left to gain.
                self.converged |= outcome.status in (0, 2)
                return
            self.converged = self.best.value - value_before < self.budget.tolerance
            if self.converged or self.steps == steps_before:
                return

    def _at(self, offset: np.ndarray, origin: np.ndarray, free: np.ndarray, scale: np.ndarray) -> np.ndarray:
        """Return the point (P',) that is scipy's offset (F,) of free parameters away from a run's origin."""
        wanted = origin.astype(np.float64)
        wanted[free] += offset / scale[free]
        return wanted

    def _negative(
        self, offset: np.ndarray, origin: np.ndarray, free: np.ndarray, scale: np.ndarray
    ) -> tuple[float, np.ndarray]:
        """Return the value that scipy minimises, and its gradient (F,).

        Where the problem has no finite value it is as bad as the worst seen, falling towards the best.
        """
        wanted = self._at(offset, origin, free, scale)
        point, value, gradient, _ = self.evaluate(wanted)
        if not np.isfinite(value) or not np.isfinite(gradient).all():
            away = ((wanted - self.best.point) * scale)[free]
            return 1.0 - self.worst, away / max(float(np.linalg.norm(away)), 1e-12)
        self.worst = min(self.worst, value)
        inside = np.isclose(wanted, point, rtol=1e-6, atol=0.0)  # rounding passes a bound a little
        return -value, -(np.where(inside, gradient, 0.0) / scale)[free]

    def _curvature(
        self, offset: np.ndarray, origin: np.ndarray, free: np.ndarray, scale: np.ndarray
    ) -> np.ndarray:
        """Return scipy's Hessian (F, F), made positive definite where parameters are not seen."""
        normal = self.evaluate(self._at(offset, origin, free, scale)).normal / np.outer(scale, scale)
        return normal[np.ix_(free, free)] + 1e-9 * np.eye(free.sum())

    def _after_step(self, intermediate_result: scipy.optimize.OptimizeResult) -> None:
        """Count a step (scipy's callback), and end the run when it gained less than the tolerance."""
        self.steps += 1
        gain, self.value_before = self.best.value - self.value_before, self.best.value
        # Only a trust region steps without a gain: it is tried again in a quarter of it, ten times at most.
        self.without_gain = 0 if gain > 0 else self.without_gain + 1
        self.converged = gain < self.budget.tolerance and self.without_gain in (0, 10)
        if self.converged or self.steps >= self.budget.iterations:
            raise StopIteration


def _fixed_parameters(at: _Evaluated, problem: Problem) -> np.ndarray:
    """Return parameters (P',) bool that are fixed or rest on a bound that the gradient pushes against."""
    lower, upper = problem.lower, problem.upper
    below, above = (at.point <= lower) & (at.gradient <= 0), (at.point >= upper) & (at.gradient >= 0)
    return below | above | (lower == upper)


def _scales(normal: np.ndarray) -> np.ndarray:
    """Return the factors by which parameters are counted in its own standard deviations: (P', P') to (P',).

    The root of the normal matrix's diagonal, at least a thousandth of the largest: a parameter that nothing
    is known of gets a finite one.
    """
    root = np.sqrt(np.diagonal(np.nan_to_num(normal)).clip(0))
    return root.clip(max(1e-3 * float(root.max(initial=0.0)), np.finfo(root.dtype).tiny))
