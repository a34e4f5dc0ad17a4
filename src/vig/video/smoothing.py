"""Angles and places of one object over the frames of a video: the likeliest views, and their smoothing."""

from __future__ import annotations

import math

import numpy as np

BINS = 180
"""Of the circle, in which views are chosen; speeds are whole bins a frame."""
FASTEST = 15
"""Bins that an object turns by from one frame to the next, at most: 30 degrees."""
SPEED_SPREAD = 1.0
"""Standard deviation in bins by which its speed changes from frame to frame."""
SPEED_OTHER = 0.02
"""Probability of any other change of the speed."""
TAILS = 4.0
"""Degrees of freedom of the Student distribution of what single frames measure."""
ROUNDS = 4
"""Rounds of reweighting, after which weights hardly change."""


def likeliest_path(log_evidence: np.ndarray) -> np.ndarray:
    """The likeliest angles of something that turns smoothly, by the Viterbi algorithm.

    The state is angle and speed. Speeds change little from a frame to the next, or rarely by anything.

    Args:
        log_evidence: (T, A) log likelihood of each frame in each bin of the circle; a constant where a frame
            says nothing.

    Returns:
        (T,) float64 centres of bins, radians, unwrapped: from one frame to the next they change by the speed.
    """
    count, bins = log_evidence.shape
    speeds = np.arange(-FASTEST, FASTEST + 1)
    change = speeds[:, None] - speeds
    usual = np.exp(-0.5 * (change / SPEED_SPREAD) ** 2)
    usual /= usual.sum(1, keepdims=True)
    log_change = np.log((1 - SPEED_OTHER) * usual + SPEED_OTHER / len(speeds))  # (from, to)
    previous_bin = (np.arange(bins)[:, None] - speeds) % bins  # the angle that a speed leads here from
    score = np.repeat(log_evidence[0][:, None], len(speeds), axis=1)
    steps = np.empty((count, bins, len(speeds)), np.int8)
    for frame in range(1, count):
        options = score[:, :, None] + log_change
        steps[frame] = options.argmax(1)  # by angle previous_bin, and speed now
        score = options.max(1)[previous_bin, np.arange(len(speeds))] + log_evidence[frame][:, None]
    angle, speed = np.unravel_index(score.argmax(), score.shape)
    path = np.empty(count)
    place = int(angle)
    for frame in range(count - 1, -1, -1):
        path[frame] = place
        if frame:
            place -= int(speeds[speed])
            speed = steps[frame, place % bins, speed]
    centres: np.ndarray = (path + 0.5) * (2 * math.pi / bins)
    return centres


def smoothed(
    values: np.ndarray, deviation: np.ndarray, acceleration: float, speed: float = math.inf
) -> np.ndarray:
    """Smooth what frames measure: Rauch, Tung and Striebel's smoother of a place with its speed.

    Single measurements may be far off: their noise is Student's, by iterated reweighting.

    Args:
        values: (T,) what is measured.
        deviation: (T,) its standard deviations; inf where nothing was.
        acceleration: Standard deviation of the change of speed from a frame to the next.
        speed: Standard deviation of the speed in the first frame, at most 100 times that.

    Returns:
        (2, T) means and standard deviations; without any measurement 0 and inf.
    """
    has_deviation = np.isfinite(deviation)
    if not has_deviation.any():
        return np.stack([np.zeros(len(values)), np.full(len(values), math.inf)])
    variance = np.where(has_deviation, deviation, 1.0) ** 2
    weight = np.ones(len(values))
    for _ in range(ROUNDS):
        estimate = _smoothed(
            values, np.where(has_deviation, variance / weight, math.inf), acceleration, speed
        )
        weight = (TAILS + 1) / (TAILS + (values - estimate[0]) ** 2 / variance)
    return estimate


def _smoothed(
    values: np.ndarray, variance: np.ndarray, acceleration: float, speed: float = math.inf
) -> np.ndarray:
    """`smoothed` of Gaussian noise of such variances (T,)."""
    step = np.array([[1.0, 1.0], [0.0, 1.0]])
    noise = acceleration**2 * np.array([[1 / 3, 1 / 2], [1 / 2, 1.0]])
    first = int(np.flatnonzero(np.isfinite(variance))[0])
    mean, spread = (
        np.array([values[first], 0.0]),
        np.diag([1e6 * variance[first], min(speed, 100 * acceleration) ** 2]),
    )
    means: list[np.ndarray] = []
    spreads: list[np.ndarray] = []
    predicted: list[tuple[np.ndarray, np.ndarray]] = []
    for value, error in zip(values, variance, strict=True):
        if means:
            mean, spread = step @ mean, step @ spread @ step.T + noise
        predicted.append((mean, spread))
        if math.isfinite(error):
            gain = spread[:, 0] / (spread[0, 0] + error)
            mean = mean + gain * (value - mean[0])
            spread = spread - np.outer(gain, spread[0])
        means.append(mean)
        spreads.append(spread)
    for frame in range(len(values) - 2, -1, -1):
        ahead, uncertain = predicted[frame + 1]
        gain = spreads[frame] @ step.T @ np.linalg.inv(uncertain)
        means[frame] = means[frame] + gain @ (means[frame + 1] - ahead)
        spreads[frame] = spreads[frame] + gain @ (spreads[frame + 1] - uncertain) @ gain.T
    return np.array([[each[0] for each in means], [math.sqrt(max(each[0, 0], 0.0)) for each in spreads]])
