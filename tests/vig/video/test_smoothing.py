"""The likeliest views of a turning object, and the smoothing of what frames measure."""

import math

import numpy as np
import pytest

from vig.video.smoothing import BINS, TAILS, LikeliestPath, _smooth_gaussian, smooth

TURN = math.radians(7.0)


def seen_at(azimuths: np.ndarray, weight: float = 3.0, spread: float = 0.1) -> np.ndarray:
    """Log evidence (T, A) of one view in each frame."""
    centres = (np.arange(BINS) + 0.5) * (2 * math.pi / BINS)
    off = (azimuths[:, None] - centres + math.pi) % (2 * math.pi) - math.pi
    return weight * np.exp(-0.5 * (off / spread) ** 2)


def likeliest_path(evidence: np.ndarray, memory: int | None = None) -> np.ndarray:
    path = LikeliestPath(memory)
    for row in evidence:
        path.add(row)
    return path.angles()


def difference(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.abs((a - b + math.pi) % (2 * math.pi) - math.pi)


@pytest.mark.parametrize("turn", [TURN, -TURN, 0.0])
def test_views_from_the_other_side_are_corrected_by_their_neighbours(turn: float) -> None:
    """Most frames decide, not the first; frames without evidence go on turning."""
    truth = 1.0 + turn * np.arange(40)
    seen = truth.copy()
    seen[[0, 1, 2, 3, 11, 12, 13, 25]] += math.pi
    evidence = seen_at(seen)
    evidence[30:36] = 0.0
    path = likeliest_path(evidence)
    off = difference(path, truth)
    assert off[4:30].max() < math.radians(5)
    assert off[30:].max() < math.radians(10)  # speeds are whole bins
    assert np.abs(np.diff(path)).max() <= math.radians(30)  # unwrapped: no jump where the circle closes


def test_a_causal_path_takes_no_single_wrong_view_and_soon_the_right_one() -> None:
    """The last angle after each frame, with the memory of a few frames."""
    truth = 1.0 + TURN * np.arange(40)
    seen = truth.copy()
    seen[[12, 16, 17, 30]] += math.pi
    seen[:3] += math.pi
    path, memory = LikeliestPath(8), []
    last: list[float] = []
    for row in seen_at(seen):
        path.add(row)
        angles = path.angles(last[-1] if last else None)
        memory.append(len(angles))
        last.append(angles[-1])
    assert memory == [*range(1, 8), *[8] * 33]
    assert difference(np.array(last), truth)[9:].max() < math.radians(5)
    assert difference(likeliest_path(seen_at(seen), 8), truth[-8:]).max() < math.radians(5)


def test_several_things_are_smoothed_as_each_by_itself() -> None:
    rng = np.random.default_rng(3)
    values, deviation = rng.normal(size=(3, 9)), rng.uniform(0.5, 2.0, (3, 9))
    deviation[0, :2] = deviation[1] = math.inf
    change, speed = np.array([0.1, 0.2, 0.3]), np.array([math.inf, 1.0, 0.01])
    together = smooth(values, deviation, change, speed)
    alone = [smooth(*row) for row in zip(values, deviation, change, speed, strict=True)]
    assert np.allclose(together, np.stack(alone, axis=1))


def test_the_path_is_the_best_of_all() -> None:
    """Against an exhaustive search where the object stands: the best bin of the summed evidence."""
    rng = np.random.default_rng(1)
    evidence = np.repeat(rng.normal(0, 5, (1, BINS)), 6, axis=0)
    path = likeliest_path(evidence)
    best = (evidence[0].argmax() + 0.5) * (2 * math.pi / BINS)
    assert difference(path, np.full(6, best)).max() < 1e-9


def test_smoothing_is_the_mean_of_the_gaussian_posterior() -> None:
    """Of all places and speeds at once, by one dense system."""
    rng, count, change = np.random.default_rng(2), 7, 0.3
    values, variance = rng.normal(size=count), rng.uniform(0.5, 2.0, count)
    variance[3] = math.inf
    precision, right = np.zeros((2 * count, 2 * count)), np.zeros(2 * count)
    for frame in range(count):
        if math.isfinite(variance[frame]):
            precision[2 * frame, 2 * frame] += 1 / variance[frame]
            right[2 * frame] += values[frame] / variance[frame]
    first = np.linalg.inv(np.diag([1e6 * variance[0], 1e4 * change**2]))
    precision[:2, :2] += first
    right[:2] += first @ [values[0], 0.0]
    noise = np.linalg.inv(change**2 * np.array([[1 / 3, 1 / 2], [1 / 2, 1.0]]))
    step = np.hstack([-np.array([[1.0, 1.0], [0.0, 1.0]]), np.eye(2)])
    for frame in range(count - 1):
        at = slice(2 * frame, 2 * frame + 4)
        precision[at, at] += step.T @ noise @ step
    covariance = np.linalg.inv(precision)
    mean, deviation = _smooth_gaussian(values, variance, change)
    assert np.allclose(mean, (covariance @ right)[::2], atol=1e-6)
    assert np.allclose(deviation, np.sqrt(covariance.diagonal()[::2]), atol=1e-6)


def test_an_outlier_hardly_counts() -> None:
    values, deviation = 0.5 * np.arange(30.0), np.full(30, 0.2)
    values[15] += 20.0
    mean, spread = smooth(values, deviation, 0.02)
    assert np.abs(mean - 0.5 * np.arange(30)).max() < 0.1
    plain = _smooth_gaussian(values, deviation**2, 0.02)[0]
    assert abs(plain[15] - 7.5) > 1.0  # what Student's tails are for
    assert (spread < 0.2).all() and TAILS > 2


def test_frames_before_the_first_measurement_are_extrapolated_and_none_are_unknown() -> None:
    values, deviation = 2.0 * np.arange(12), np.full(12, 0.1)
    deviation[:4] = math.inf
    mean, spread = smooth(values, deviation, 0.01)
    assert np.abs(mean - values).max() < 0.3
    assert spread[0] > spread[4]
    mean, spread = smooth(np.ones(4), np.full(4, math.inf), 0.1)
    assert (mean == 0).all() and np.isinf(spread).all()


def test_a_few_frames_do_not_tell_a_speed_that_is_unlikely() -> None:
    """What they show is their mean, and stays so where nothing is seen."""
    values, deviation = np.zeros(20), np.full(20, math.inf)
    values[:4], deviation[:4] = [0.0, 0.4, 0.8, 1.2], 1.0
    assert abs(smooth(values, deviation, 0.01, speed=0.01)[0][-1] - 0.6) < 0.3
    assert smooth(values, deviation, 0.01)[0][-1] > 2.0
