import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import scipy.stats

from tests.support import POINT, assert_close, points_of
from vig.inference import Objective, RecognitionPrior
from vig.inference.objective import Prior
from vig.renderer.drawing import draw_latents
from vig.scene import Latents, ObjectClass, rotate_z
from vig.scene.latents import FRAMING


@pytest.fixture(scope="module")
def objective(studio, teapot: ObjectClass) -> Objective:
    return Objective(
        studio.likelihood(studio.blocks(np.random.default_rng(0))[None]), teapot, free_framing=True
    )


def test_a_point_is_the_latents_then_the_framing(studio, objective: Objective) -> None:
    latents = studio.latents(np.random.default_rng(1), 4)
    framing = np.full((4, 4), 0.01)
    points = objective.point(latents, framing)
    assert_close(points, points_of(latents, framing))
    assert_close(objective.framing(points), framing)
    assert_close(objective.latents(points).to_vector(), latents.to_vector())
    assert not objective.framing(objective.point(latents)).any()


def test_tensors_are_taken_as_arrays(studio, objective: Objective, teapot: ObjectClass) -> None:
    torch = pytest.importorskip("torch")
    latents = studio.latents(np.random.default_rng(1), 1)
    of_torch = Latents.from_vector(torch.from_numpy(latents.to_vector()).requires_grad_())
    point, photo, sigma = objective.point(latents), np.zeros(1, np.int32), np.array([0.05])
    assert_close(objective.point(of_torch), point)
    assert_close(objective.latents(torch.from_numpy(point)).to_vector(), latents.to_vector())
    tensors = map(torch.from_numpy, (point, photo, sigma))
    assert_close(objective(*tensors).value, objective(point, photo, sigma).value)
    drawn = [draw_latents(each, teapot, teapot.camera()).rgb for each in (latents, of_torch)]
    assert_close(*drawn)


def test_points_lie_within_the_bounds(objective: Objective) -> None:
    rng = np.random.default_rng(2)
    wild = Latents.from_vector(rng.normal(0, 50, (20, 24)))
    points = objective.point(wild, rng.normal(0, 5, (20, 4)))
    assert (points >= objective.lower).all() and (points <= objective.upper).all()
    shape, elevation, albedo = (points[:, POINT[name]] for name in ("shape", "elevation", "albedo"))
    assert np.abs(shape).max() == 3.0
    assert elevation.min() == 0 and elevation.max() == pytest.approx(math.pi / 2)
    assert albedo.min() == 0 and albedo.max() == 1
    assert_close(points[:, POINT.at("azimuth")], wild.azimuth)  # any angle is an azimuth
    assert_close(points[:, POINT["light"]], wild.light)


def test_a_free_framing_reaches_two_fifths_of_the_width_and_its_prior_is_narrower(
    objective: Objective,
) -> None:
    """Shifts reach 0.4 widths, magnification e, roll 0.4; one deviation is half a nat."""
    far = np.full((1, 4), 9.0)
    nothing = Latents.from_vector(np.zeros((1, 24)))
    for sign in (-1, 1):
        reached = objective.framing(objective.point(nothing, sign * far))[0]
        assert reached.tolist() == pytest.approx([sign * 0.4, sign * 0.4, sign * 1.0, sign * 0.4])
    still = objective.prior.value(objective.point(nothing))
    for column, deviation in enumerate((0.1, 0.1, 0.3, 0.05)):
        framing = np.zeros((1, 4))
        framing[0, column] = deviation
        assert still - objective.prior.value(objective.point(nothing, framing)) == pytest.approx(0.5)


def test_the_priors_weight_multiplies_all_of_it_but_the_framings(
    studio, objective: Objective, teapot
) -> None:
    rng = np.random.default_rng(11)
    recognition = replace(some_recognition_prior(rng), azimuth_precision=0.0)  # it has a weight of its own
    once, sevenfold = (
        Objective(objective.likelihood, teapot, True, recognition, prior_weight=weight).prior
        for weight in (1, 7)
    )
    latents = studio.latents(rng, 2)
    points = objective.point(latents)
    gains = [np.diff(prior.value(points))[0] for prior in (once, sevenfold)]
    assert abs(gains[0]) > 0.1 and gains[1] == pytest.approx(7 * gains[0])
    framed = objective.point(latents, np.full((2, 4), 0.05))
    costs = [prior.value(framed) - prior.value(points) for prior in (once, sevenfold)]
    assert_close(costs[0], costs[1])


def test_a_held_framing_is_zero_whatever_is_asked(studio, teapot: ObjectClass) -> None:
    held = Objective(studio.likelihood(studio.blocks(np.random.default_rng(3))[None]), teapot)
    points = held.point(studio.latents(np.random.default_rng(4)), np.full((1, 4), 0.1))
    assert not held.framing(points).any()
    assert np.array_equal(held.lower[POINT["framing"]], held.upper[POINT["framing"]])


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("column", [0, 10, 14, 23])
def test_latents_that_are_not_finite_are_refused(objective: Objective, bad: float, column: int) -> None:
    vector = np.zeros((2, 24))
    vector[1, column] = bad
    with pytest.raises(ValueError, match="latents must be finite"):
        objective.point(Latents.from_vector(vector))


def test_latents_of_another_class_are_refused(objective: Objective) -> None:
    with pytest.raises(ValueError, match=r"latents must be \(B, 24\); got \(1, 20\)"):
        objective.point(Latents.from_vector(np.zeros((1, 20))))


def test_the_prior_is_that_of_shape_light_and_framing(
    studio, objective: Objective, teapot: ObjectClass
) -> None:
    rng = np.random.default_rng(5)
    points = objective.point(studio.latents(rng, 3), rng.normal(0, 0.03, (3, 4)))
    shape = scipy.stats.norm.logpdf(points[:, POINT["shape"]]).sum(1)
    of_light = scipy.stats.multivariate_normal(teapot.light_prior_mean, teapot.light_prior_covariance)
    light = of_light.logpdf(points[:, POINT["light"]])
    framing = scipy.stats.norm.logpdf(objective.framing(points), 0.0, FRAMING.deviation).sum(1)
    off = objective.prior.value(points) - (shape + light + framing)
    assert_close(off, np.full(3, off[0]))  # equal up to one constant
    moved = points.copy()
    moved[:, POINT.indices("azimuth", "elevation", "albedo")] += 0.1  # pose and albedo are uniform
    assert_close(objective.prior.value(moved), objective.prior.value(points))


def some_recognition_prior(rng: np.random.Generator) -> RecognitionPrior:
    views = np.array([0.3, 3.0, 6.2])
    recognition = RecognitionPrior(rng.normal(size=24), rng.uniform(0, 4, 24), views, 5.0)
    recognition.precision[[2, 10]] = 0.0  # nothing is said of a component and of azimuth
    return recognition


def test_a_recognition_prior_multiplies_the_prior_its_light_in_the_heading_frame(
    studio, objective: Objective, teapot: ObjectClass
) -> None:
    rng = np.random.default_rng(8)
    recognition = some_recognition_prior(rng)
    believing = Objective(objective.likelihood, teapot, free_framing=True, recognition=recognition)
    latents = studio.latents(rng, 4)
    points = objective.point(latents)
    seen = objective.latents(points).to_vector()
    seen[:, POINT["light"]] = rotate_z(latents.light, -latents.azimuth)
    said = -0.5 * (recognition.precision * (seen - recognition.mean) ** 2).sum(1)
    nearest = np.arccos(np.cos(latents.azimuth[:, None] - recognition.azimuths).max(1))
    said = said - 0.5 * 5.0 * nearest**2
    off = believing.prior.value(points) - objective.prior.value(points) - said
    assert_close(off, np.full(4, off[0]))  # equal up to one constant


def differences(function: Callable[[np.ndarray], np.ndarray], points: np.ndarray) -> np.ndarray:
    """Central differences of a function of points (B, P'), by each number of these: (B, ..., P')."""
    steps = 1e-5 * np.eye(points.shape[1])
    return np.stack([(function(points + s) - function(points - s)) / 2e-5 for s in steps], -1)


def derivatives_of(prior: Prior, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    count, size = points.shape
    added = np.zeros(count), np.zeros((count, size)), np.zeros((count, size, size))
    prior.add_to(points, *added)
    return added


def test_a_recognition_priors_derivatives_are_exact_and_its_matrix_is_that_of_its_residuals(
    studio, objective: Objective, teapot: ObjectClass
) -> None:
    rng = np.random.default_rng(9)
    recognition = some_recognition_prior(rng)
    prior = Objective(objective.likelihood, teapot, recognition=recognition).prior
    points = objective.point(studio.latents(rng, 3))
    value, gradient, normal = derivatives_of(prior, points)
    assert_close(value, prior.value(points))
    assert_close(gradient, differences(prior.value, points), atol=1e-6, rtol=1e-6)
    assert np.linalg.eigvalsh(normal).min() > -1e-9
    # Where the residual of the light is zero the Gauss-Newton matrix is the Hessian.
    fitting = points[:1].copy()
    fitting[:, POINT["light"]] = rotate_z(
        recognition.mean[POINT["light"]][None], fitting[:, POINT.at("azimuth")]
    )
    curvature = differences(lambda p: -derivatives_of(prior, p)[1], fitting)
    assert_close(derivatives_of(prior, fitting)[2], curvature, atol=1e-6, rtol=1e-6)


def test_the_priors_derivatives_are_added_to_the_likelihoods(studio, objective: Objective) -> None:
    rng = np.random.default_rng(6)
    points = objective.point(studio.latents(rng, 2), rng.normal(0, 0.03, (2, 4)))
    valued = objective(points, *studio.whose(2))
    below = objective.likelihood.at(points, *studio.whose(2))
    assert_close(valued.value, below.value + objective.prior.value(points))
    slope = differences(objective.prior.value, points)
    assert_close(valued.gradient - below.gradient, slope, atol=1e-5, rtol=1e-6)
    curvature = differences(lambda p: -derivatives_of(objective.prior, p)[1], points)
    assert_close(valued.normal - below.normal, curvature, atol=1e-4, rtol=1e-6)
