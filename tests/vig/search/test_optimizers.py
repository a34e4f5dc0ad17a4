"""Every optimiser on photos whose explanation is known."""

from __future__ import annotations

import math

import numpy as np
import pytest

from vig.inference import Objective
from vig.scene import Latents, ObjectClass
from vig.search.annealing import Annealed
from vig.search.levenberg_marquardt import LevenbergMarquardt
from vig.search.optimizer import Budget, Descent, Optimizer
from vig_paper.optimizers import BFGS, LBFGS, ConjugateGradient, Dogleg, GradientDescent

SIGMA = 0.03
OPTIMIZERS: dict[str, Optimizer] = {
    "levenberg_marquardt": LevenbergMarquardt(),
    "dogleg": Dogleg(),
    "lbfgs": LBFGS(),
    "bfgs": BFGS(),
    "conjugate_gradient": ConjugateGradient(),
    "gradient_descent": GradientDescent(),
    "annealed": Annealed(LevenbergMarquardt()),
}
BUDGET = Budget(15)


def start_near(studio, rng: np.random.Generator, truth: Latents) -> Latents:
    """3 degrees off in azimuth and elevation, 0.3 sd in shape, a little in colour and light."""
    modes = studio.geometry.model.modes
    size = np.array([0.3] * modes + [math.radians(3)] * 2 + [0.03] * 3 + [0.0] + [0.1] * 8)
    sign = rng.choice([-1.0, 1.0], (len(truth), len(size)))
    return Latents.from_vector(truth.to_vector() + sign * size)


def degrees_off(objective: Objective, points: np.ndarray, truth: Latents) -> tuple[float, float]:
    found = objective.latents(points)
    azimuth = (found.azimuth - truth.azimuth + math.pi) % (2 * math.pi) - math.pi
    tilt = found.elevation - truth.elevation
    return math.degrees(np.abs(azimuth).max()), math.degrees(np.abs(tilt).max())


def search(
    studio,
    teapot: ObjectClass,
    optimizer: Optimizer,
    seed: int,
    occluded: bool,
    budget: Budget = BUDGET,
    **photo: np.ndarray,
) -> tuple[Objective, np.ndarray, Latents, Descent]:
    """An objective of a photo with noise of 0.01, the start, the truth and where the search ended."""
    rng = np.random.default_rng(seed)
    truth = studio.latents(rng)
    shown = studio.photo(rng, truth, occluded=occluded, noise=0.01, **photo)
    objective = Objective(studio.likelihood(shown), teapot, free_framing=bool(photo))
    start = objective.point(start_near(studio, rng, truth))
    return objective, start, truth, optimizer(objective, start, studio.whose(1)[0], SIGMA, budget)


@pytest.mark.parametrize("occluded", [False, True], ids=["whole", "occluded"])
@pytest.mark.parametrize("name", OPTIMIZERS)
def test_a_search_gains_and_stays_in_bounds(studio, teapot: ObjectClass, name: str, occluded: bool) -> None:
    objective, start, _, end = search(studio, teapot, OPTIMIZERS[name], 0, occluded)
    before, after = (objective(p, *studio.whose(1)).value.item() for p in (start, end.points))
    assert end.value.item() == pytest.approx(after)
    assert after > before + 100
    assert (end.points >= objective.lower).all() and (end.points <= objective.upper).all()
    assert end.points.shape == start.shape and end.evaluations.shape == end.converged.shape == (1,)
    assert end.evaluations.item() > 1 and end.converged.dtype == bool
    assert not objective.framing(end.points).any()  # it is held


def test_one_descent_mostly_finds_a_teapot_seen_whole(studio, teapot: ObjectClass) -> None:
    """Three in four do; the others stall short of the truth's own value (DESIGN section 3)."""
    off, short = [], []
    for seed in range(8):
        objective, _, truth, end = search(
            studio, teapot, LevenbergMarquardt(damping=1.0), seed, False, Budget()
        )
        off.append(max(degrees_off(objective, end.points, truth)))
        at_truth = objective(objective.point(truth), *studio.whose(1)).value.item()
        short.append(at_truth - end.value.item())
    found = np.array(off) < 0.5
    assert found.sum() >= 5
    assert np.median(np.array(short)[found]) < 20


def test_the_best_of_several_descents_finds_occluded_teapots(studio, teapot: ObjectClass) -> None:
    """One descent may stall (DESIGN section 3); the best of eight mostly ends no lower than the truth itself.

    The maximum is not quite at the truth: the model rewards drawing the silhouette off the occluder.
    """
    off, short = [], []
    for seed in range(5):
        rng = np.random.default_rng(seed)
        truth = studio.latents(rng)
        objective = Objective(studio.likelihood(studio.photo(rng, truth, noise=0.01)), teapot)
        eight = truth[np.zeros(8, np.int64)]
        starts = objective.point(start_near(studio, rng, eight))
        end = Annealed(LevenbergMarquardt())(objective, starts, studio.whose(8)[0], SIGMA, Budget(90))
        best = int(end.value.argmax())
        off.append(max(degrees_off(objective, end.points[best : best + 1], truth)))
        at_truth = objective(objective.point(truth), *studio.whose(1)).value.item()
        short.append(at_truth - end.value[best].item())
    assert (np.array(off) < 1).sum() >= 4 and max(off) < 3
    assert (np.array(short) < 20).sum() >= 3 and max(short) < 200


def test_a_free_framing_finds_shifts_of_two_pixels(studio, teapot: ObjectClass) -> None:
    shift = np.array([[2 / 150, -2 / 150, 0.0, 0.0]])
    found = []
    for seed in range(6):
        objective, start, _, end = search(
            studio, teapot, Annealed(LevenbergMarquardt()), seed, False, Budget(90), framing=shift
        )
        assert not objective.framing(start).any()
        found.append(objective.framing(end.points)[0, :2] * 150)
    # Upright shifts trade against elevation, height and magnification, all a priori likely.
    across, down = np.median(found, axis=0)
    assert abs(across - 2) < 0.3 and abs(down + 2) < 0.8


def test_levenberg_marquardt_treats_each_search_of_a_batch_alone(studio, teapot: ObjectClass) -> None:
    rng = np.random.default_rng(11)
    truth = studio.latents(rng, 2)
    photos = np.concatenate([studio.photo(rng, truth[i : i + 1], noise=0.01) for i in range(2)])
    objective = Objective(studio.likelihood(photos), teapot)
    starts = objective.point(start_near(studio, rng, truth))
    short = LevenbergMarquardt()
    few = Budget(6)  # rounding grows along a longer way
    together = short(objective, starts, np.array([0, 1]), SIGMA, few)
    for i in range(2):
        alone = short(objective, starts[i : i + 1], np.array([i]), SIGMA, few)
        np.testing.assert_allclose(alone.points[0], together.points[i], atol=1e-6, rtol=0)
        assert alone.evaluations[0] == together.evaluations[i]


def test_a_budget_that_ends_is_told(studio, teapot: ObjectClass) -> None:
    _, _, _, end = search(studio, teapot, LevenbergMarquardt(), 0, True, Budget(2))
    assert not end.converged.item() and end.evaluations.item() == 3


@pytest.mark.parametrize("iterations", [2, 6, 40])
def test_a_search_without_a_matrix_at_its_end_goes_the_same_way(studio, teapot, iterations: int) -> None:
    ends = []
    for curvature in (True, False):
        budget = Budget(iterations, 5.0, curvature)
        ends.append(search(studio, teapot, LevenbergMarquardt(), 0, True, budget)[3])
    with_matrix, without = ends
    assert with_matrix.normal is not None and without.normal is None
    assert with_matrix.converged.item() == without.converged.item() == (iterations > 6)
    for one, two in zip(with_matrix.path, without.path, strict=True):
        assert np.array_equal(one, two)
    assert np.array_equal(with_matrix.value, without.value)


@pytest.mark.parametrize("name", OPTIMIZERS)
def test_a_start_on_a_bound_may_leave_it_and_none_is_passed(studio, teapot: ObjectClass, name: str) -> None:
    rng = np.random.default_rng(21)
    truth = studio.latents(rng)
    objective = Objective(studio.likelihood(studio.photo(rng, truth, noise=0.01)), teapot)
    vector = truth.to_vector()
    vector[:, :3], vector[:, 12] = 9.0, -1.0  # clamped to 3 sd and to black
    start = objective.point(Latents.from_vector(vector))
    end = OPTIMIZERS[name](objective, start, studio.whose(1)[0], SIGMA, BUDGET)
    assert (end.points >= objective.lower).all() and (end.points <= objective.upper).all()
    assert end.value.item() > objective(start, *studio.whose(1)).value.item()
    assert end.points[0, 12] > 0.1  # the red came back


@pytest.mark.parametrize("name", OPTIMIZERS)
def test_the_callers_starts_are_left_alone(studio, teapot: ObjectClass, name: str) -> None:
    rng = np.random.default_rng(13)
    truth = studio.latents(rng)
    objective = Objective(studio.likelihood(studio.photo(rng, truth)), teapot)
    start = objective.point(start_near(studio, rng, truth))
    kept = start.copy()
    OPTIMIZERS[name](objective, start, studio.whose(1)[0], SIGMA, BUDGET)
    assert np.array_equal(start, kept)
