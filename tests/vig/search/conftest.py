"""A zoo of small problems with known answers, which every optimiser has to solve."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest

from tests.support import points_of
from vig.inference import Objective
from vig.likelihood import Likelihood, Photos, PixelModel
from vig.likelihood.geometry import Geometry
from vig.scene import Camera, Latents, ObjectClass
from vig.search.optimizer import Evaluation, Problem

INFINITY = math.inf
Residuals = Callable[[np.ndarray], np.ndarray]

PAPERS = PixelModel(0.03, 0.9)


class LeastSquares:
    """-1/2 sum r(x)^2 / sigma^2 of residuals (..., P') -> (..., N), or with `inliers` < 1 the log of a
    mixture, inliers exp(-1/2 r^2 / sigma^2) + 1 - inliers; `nothing` (NaN or -inf)
    where `outside` holds of a point.

    Derivatives of residuals as of complex numbers, these weighed by their posteriors.
    """

    dtype = np.float64

    def __init__(
        self,
        residuals: Residuals,
        lower: list[float],
        upper: list[float],
        inliers: float = 1.0,
        outside: Callable[[np.ndarray], np.ndarray] | None = None,
        nothing: float = math.nan,
    ):
        self.residuals, self.inliers, self.outside, self.nothing = residuals, inliers, outside, nothing
        self.lower, self.upper = np.array(lower, np.float64), np.array(upper, np.float64)

    def __call__(
        self, points: np.ndarray, photo: np.ndarray, sigma: np.ndarray, derivatives: bool = True
    ) -> Evaluation:
        residuals = self.residuals(points) / sigma[:, None]
        agreement = self.inliers * np.exp(-0.5 * residuals**2)
        mixture = agreement + 1 - self.inliers
        value = (np.log(mixture) if self.inliers < 1 else -0.5 * residuals**2).sum(1)
        off = np.zeros(len(points), bool) if self.outside is None else self.outside(points)
        value[off] = self.nothing
        if not derivatives:
            return Evaluation(value)
        # d r_n / d x_p as (B, P', N): the imaginary part of a small imaginary step is exact.
        steps = 1e-20j * np.eye(points.shape[1])
        jacobian = self.residuals(points[:, None] + steps).imag / 1e-20 / sigma[:, None, None]
        weights = agreement / mixture if self.inliers < 1 else np.ones_like(residuals)
        gradient = -np.einsum("bn,bpn->bp", weights * residuals, jacobian)
        normal = np.einsum("bn,bpn,bqn->bpq", weights, jacobian, jacobian)
        gradient[off] = normal[off] = math.nan
        return Evaluation(value, gradient, normal)


class Watched:
    """A problem that counts how often each photo's points were valued, and holds that all were allowed."""

    def __init__(self, problem: Problem):
        self.problem = problem
        self.lower, self.upper = problem.lower, problem.upper
        self.dtype = problem.dtype
        self.calls: list[np.ndarray] = []
        self.best: dict[int, float] = {}

    def __call__(
        self, points: np.ndarray, photo: np.ndarray, sigma: np.ndarray, derivatives: bool = True
    ) -> Evaluation:
        assert points.dtype == self.dtype and len(points) == len(photo) == len(sigma) > 0
        assert np.isfinite(points).all(), "a point that is no number"
        assert ((points >= self.lower) & (points <= self.upper)).all(), "a point outside the bounds"
        self.calls.append(photo.copy())
        valued = self.problem(points, photo, sigma, derivatives)
        for which, value in zip(photo.tolist(), valued.value.tolist(), strict=True):
            if value > self.best.get(which, -INFINITY):
                self.best[which] = value
        return valued

    def counted(self, searches: int) -> np.ndarray:
        """How often each photo was valued, (searches,)."""
        return np.bincount(np.concatenate(self.calls), minlength=searches)


@dataclass(frozen=True)
class Case:
    """A problem, starts (B, P'), noise, the highest value (B,) that each search should come near by, and
    what more is known of the ends: `check(points)` asserts it.
    """

    problem: Problem
    starts: np.ndarray
    answer: np.ndarray
    check: Callable[[np.ndarray], None]
    sigma: float = 1.0


def near(target: list[float], within: float) -> Callable[[np.ndarray], None]:
    """All ends within a distance of a point, parameter by parameter."""

    def check(points: np.ndarray) -> None:
        off = np.abs(points - target).max()
        assert off < within, f"off by {off:g}"

    return check


def free(size: int) -> tuple[list[float], list[float]]:
    return [-INFINITY] * size, [INFINITY] * size


def stack(*residuals: np.ndarray) -> np.ndarray:
    return np.stack(residuals, axis=-1)


def rows(*points: list[float]) -> np.ndarray:
    return np.array(points)


def quadratic() -> Case:
    matrix = np.array([[2.0, 0.5, 0.0], [0.0, 1.5, -0.5], [0.3, 0.0, 1.0]])
    target = np.array([1.0, -2.0, 0.5])
    problem = LeastSquares(lambda x: (x - target) @ matrix.T, *free(3))
    starts = rows([10.0, 10.0, 10.0], [-3.0, 0.0, 40.0], [1.0, -2.0, 0.5])
    return Case(problem, starts, np.zeros(3), near(target.tolist(), 0.5))


def ill_conditioned() -> Case:
    """Curvatures from 1 to 1e4 along turned axes: scaling single parameters does not help."""
    turn, _ = np.linalg.qr(np.random.default_rng(0).normal(size=(5, 5)))
    matrix = np.diag([1.0, 3.0, 10.0, 30.0, 100.0]) @ turn
    problem = LeastSquares(lambda x: x @ matrix.T, *free(5))
    along = np.array([[20.0, 5.0, 1.0, 1.0, 0.1], [-30.0, 5.0, 2.0, 0.0, 0.0]])
    starts = along @ turn
    return Case(problem, starts, np.zeros(2), near([0.0] * 5, 1.5))


def rosenbrock() -> Case:
    problem = LeastSquares(lambda x: stack(10 * (x[..., 1] - x[..., 0] ** 2), 1 - x[..., 0]), *free(2))
    return Case(problem, rows([-1.2, 1.0], [2.0, -1.0]), np.zeros(2), near([1.0, 1.0], 0.3), sigma=0.1)


def active_bounds() -> Case:
    """-1/2 (x - m)' Q (x - m) in [0, 1]^3, its highest point at (1, 0.5, 0), not where m would be clamped to.

    At it the gradient Q (m - x) is (2, 0, -3): outward at both bounds, none along the free parameter. The
    value there is -1/2 (m - x)' Q (m - x) with m - x = Q^-1 (2, 0, -3).
    """
    root = np.array([[1.0, 0.8, 0.0], [0.0, 1.0, 0.7], [0.0, 0.0, 0.5]])
    outward = np.array([2.0, 0.0, -3.0])
    off = np.linalg.solve(root.T @ root, outward)
    mean = np.array([1.0, 0.5, 0.0]) + off
    assert not 0.4 < mean[1] < 0.6
    problem = LeastSquares(lambda x: (x - mean) @ root.T, [0.0] * 3, [1.0] * 3)
    starts = rows([0.5, 0.5, 0.5], [0.0, 0.0, 1.0], [0.0, 1.0, 1.0], [1.0, 0.0, 0.0])
    return Case(problem, starts, np.full(4, -0.5 * off @ outward), near([1.0, 0.5, 0.0], 0.2), sigma=1.0)


def outliers() -> Case:
    """A parabola through 60 points of which 20 lie: all by the same way, so that least squares is off."""
    rng = np.random.default_rng(1)
    x = rng.uniform(-1, 1, 60)
    truth = np.array([0.5, -1.0, 0.8])
    design = np.stack([np.ones_like(x), x, x * x], axis=1)
    y = design @ truth + rng.normal(0, 0.05, 60)
    y[:20] += rng.uniform(0.5, 3, 20)
    problem = LeastSquares(lambda z: z @ design.T - y, *free(3), inliers=0.6)
    sigma = 0.05
    highest = problem(truth[None], np.zeros(1), np.full(1, sigma), derivatives=False).value
    starts = truth + rows([0.15, -0.1, -0.1], [-0.1, 0.1, 0.1])
    return Case(problem, starts, np.repeat(highest, 2), near(truth.tolist(), 0.08), sigma)


def bundle() -> Case:
    """x^2 should be 1 and y 0: starts on either side find their own root, one on the saddle cannot move.

    None may disturb the others. At x = 0 the slope is 0 and the residual 1: the value is -1/2 / s^2 = -50.
    """
    problem = LeastSquares(lambda x: stack(x[..., 0] ** 2 - 1, 0.1 * x[..., 1]), [-2.0, -5.0], [2.0, 5.0])
    starts = rows([0.5, 1.0], [-0.3, 5.0], [0.0, 0.0], [1.0, 0.0], [2.0, -5.0])
    answer = np.array([0.0, 0.0, -50.0, 0.0, 0.0])

    def check(points: np.ndarray) -> None:
        np.testing.assert_allclose(points[:, 0], [1.0, -1.0, 0.0, 1.0, 1.0], atol=0.05, rtol=0)
        assert np.array_equal(points[2], starts[2])

    return Case(problem, starts, answer, check, sigma=0.1)


def pose() -> Case:
    """Azimuth (any), elevation in [0, pi/2] and scale of 12 points seen from afar; starts turns away."""
    rng = np.random.default_rng(2)
    solid = rng.normal(size=(12, 3))
    truth = np.array([2.5, 0.6, 1.3])

    def seen(z: np.ndarray) -> np.ndarray:
        cos, sin, scale = np.cos(z)[..., None], np.sin(z)[..., None], z[..., 2, None]
        right = cos[..., 0, :] * solid[:, 0] + sin[..., 0, :] * solid[:, 1]
        away = -sin[..., 0, :] * solid[:, 0] + cos[..., 0, :] * solid[:, 1]
        return scale * np.concatenate([right, cos[..., 1, :] * solid[:, 2] - sin[..., 1, :] * away], axis=-1)

    photo = seen(truth)
    problem = LeastSquares(lambda z: seen(z) - photo, [-INFINITY, 0.0, 0.1], [INFINITY, math.pi / 2, 3.0])
    starts = truth + rows([0.5, -0.6, -1.0], [-0.5 + 4 * math.pi, 0.5, 0.7], [0.4 - 2 * math.pi, 0.0, 0.0])

    def check(points: np.ndarray) -> None:
        turned = (points[:, 0] - truth[0] + math.pi) % (2 * math.pi) - math.pi
        assert np.abs(turned).max() < 0.02
        assert np.abs(points[:, 1:] - truth[1:]).max() < 0.05

    return Case(problem, starts, np.zeros(3), check, sigma=0.05)


def flat() -> Case:
    """Three parameters of which only the sum of the first two is seen: a singular normal matrix."""
    one_two = np.array([1.0, 2.0])
    problem = LeastSquares(lambda x: (x[..., 0] + x[..., 1] - 3)[..., None] * one_two, *free(3))

    def check(points: np.ndarray) -> None:
        assert np.abs(points[:, :2].sum(1) - 3).max() < 0.5
        assert points[:, 2].tolist() == [7.0, -7.0]
        assert np.abs(points).max() < 50

    return Case(problem, rows([10.0, -2.0, 7.0], [0.0, 0.0, -7.0]), np.zeros(2), check)


def cliff(nothing: float) -> Case:
    """log x should be 0 and y 1: there is no value for x <= 0, where a Gauss-Newton step, -x log x, leads."""
    problem = LeastSquares(
        lambda x: stack(np.log(np.maximum(x[..., 0], 1e-9)), x[..., 1] - 1),
        *free(2),
        outside=lambda x: x[:, 0] <= 0,
        nothing=nothing,
    )
    return Case(problem, rows([8.0, 3.0], [20.0, -3.0], [0.3, 0.0]), np.zeros(3), near([1.0, 1.0], 0.2), 0.3)


@dataclass(frozen=True)
class Zoo:
    """The problems that need no class, and a small photo of a teapot behind coloured blocks."""

    teapot: ObjectClass
    geometry: Geometry

    def __call__(self, name: str) -> Case:
        return self.photo() if name == "photo" else PROBLEMS[name]()

    def photo(self) -> Case:
        """50 x 50 pixels, a block in front; starts 3 degrees and 0.2 deviations of shape off."""
        rng = np.random.default_rng(5)
        camera = Camera.standard(50, self.teapot.target_height)
        light = np.array([2.36, 0.3, 1.0, -0.4, 0.2, -0.1, 0.1, 0.2, -0.2])
        vector = np.concatenate([rng.normal(size=10).clip(-1.5, 1.5), [0.9, 0.5], [0.7, 0.4, 0.3], light])
        truth = Latents.from_vector(vector[None])

        def likelihood(photos: np.ndarray) -> Likelihood:
            return Likelihood(self.geometry, camera, Photos(photos, PAPERS.log_prior(50, 50)[None]))

        none, one = np.zeros(1, np.int32), np.full(1, PAPERS.sigma)
        blank = np.zeros((1, 50, 50, 3))
        seen = likelihood(blank).at(points_of(truth), none, one, derivatives=False, images=True)
        cells = np.kron(rng.uniform(0.1, 0.9, (10, 10, 3)), np.ones((5, 5, 1)))
        colour = seen.irradiance[..., None] * truth.albedo
        photo = np.where(seen.coverage[..., None] > 0.5, colour, cells)
        photo[:, 15:40, 10:22] = cells[::-1][15:40, 10:22]
        photo = (photo + rng.normal(0, 0.01, photo.shape)).clip(0, 1)
        objective = Objective(likelihood(photo), self.teapot)
        sizes = np.array([0.2] * 10 + [math.radians(3)] * 2 + [0.03] * 3 + [0.0] + [0.1] * 8, np.float32)
        signs = rng.choice([-1.0, 1.0], (2, 24))
        starts = objective.point(Latents.from_vector(truth.to_vector() + signs * sizes))
        answer = objective(objective.point(truth), none, one, derivatives=False).value
        objective_of_two = _OnePhoto(objective)

        def check(points: np.ndarray) -> None:
            off = np.degrees(np.abs(points[:, 10:12] - vector[10:12]))
            assert off.max() < 4, off

        return Case(objective_of_two, starts, np.repeat(answer, 2), check, PAPERS.sigma)


class _OnePhoto:
    """An objective of one photo, asked as if each search had its own."""

    def __init__(self, objective: Objective):
        self.objective = objective
        self.lower, self.upper = objective.lower, objective.upper
        self.dtype = objective.dtype

    def __call__(
        self, points: np.ndarray, photo: np.ndarray, sigma: np.ndarray, derivatives: bool = True
    ) -> Evaluation:
        valued = self.objective(points, np.zeros_like(photo), sigma, derivatives)
        return Evaluation(valued.value, valued.gradient, valued.normal)


PROBLEMS: dict[str, Callable[[], Case]] = {
    "quadratic": quadratic,
    "ill_conditioned": ill_conditioned,
    "rosenbrock": rosenbrock,
    "active_bounds": active_bounds,
    "outliers": outliers,
    "bundle": bundle,
    "pose": pose,
    "flat": flat,
    "cliff_nan": lambda: cliff(math.nan),
    "cliff_infinite": lambda: cliff(-INFINITY),
}


@pytest.fixture(scope="session")
def zoo(teapot: ObjectClass) -> Zoo:
    return Zoo(teapot, Geometry(teapot.shape_model, np.float64))


@pytest.fixture(params=[*PROBLEMS, "photo"])
def case(request: pytest.FixtureRequest, zoo: Zoo) -> tuple[str, Case]:
    """Each problem in turn, with its name."""
    return request.param, zoo(request.param)


@pytest.fixture
def watch() -> Callable[[Problem], Watched]:
    return Watched


@pytest.fixture
def least_squares() -> type[LeastSquares]:
    return LeastSquares
