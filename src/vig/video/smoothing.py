"""Angles and places of one object over the frames of a video: the likeliest views, and their smoothing."""

import math
from collections import deque

import numpy as np

BINS = 180  # bins of the circle, in which views are chosen; speeds are whole bins a frame
FASTEST = 15  # bins that an object turns by from one frame to the next, at most: 30 degrees
SPEED_OTHER = 0.02  # probability of any other change of the speed
KEEPING = 4.0
"""Nats by which a path must be likelier than those that continue from the last angle, to replace them.
Chosen, as `vig.video.tracker`'s numbers, on videos of the validation split by benchmarks.tracking."""
TAILS = 4.0  # degrees of freedom of the Student distribution of single frames' measurements
SPEEDS = np.arange(-FASTEST, FASTEST + 1)  # (S,) bins a frame
# 1.0: standard deviation in bins by which its speed changes from frame to frame
_USUAL = np.exp(-0.5 * ((SPEEDS[:, None] - SPEEDS) / 1.0) ** 2)
LOG_CHANGE = np.log((1 - SPEED_OTHER) * _USUAL / _USUAL.sum(1, keepdims=True) + SPEED_OTHER / len(SPEEDS))
"""(S, S) log probabilities from a speed to that of the next frame."""


class LikeliestPath:
    """The likeliest angles of something that turns smoothly, frame by frame: the Viterbi algorithm.

    The state is angle and speed. Speeds change little from a frame to the next, or rarely by anything.
    """

    def __init__(self, memory: int | None = None):
        """`memory`: number of frames whose angles are kept, the latest ones; without it all."""
        self._score = np.zeros((0, len(SPEEDS)))
        self._steps: deque[np.ndarray] = deque(maxlen=memory)

    def add(self, log_evidence: np.ndarray) -> None:
        """Update by a frame's log likelihood (A,) by bins of the circle, constant without evidence."""
        bins = len(log_evidence)
        best = np.zeros((bins, len(SPEEDS)), np.int8)
        if not len(self._score):
            self._score = np.zeros(best.shape)
        else:
            options = self._score[:, :, None] + LOG_CHANGE
            best = options.argmax(1).astype(np.int8)  # by the angle before, and speed now
            before = (np.arange(bins)[:, None] - SPEEDS) % bins
            self._score = options.max(1)[before, np.arange(len(SPEEDS))]
        self._score = self._score + log_evidence[:, None]
        self._steps.append(best)

    def angles(self, near: float | None = None) -> np.ndarray:
        """Return the likeliest angles (T,) float64 of all frames so far: centres of bins, radians, unwrapped.

        near: radians of the frame before, by which another path must be likelier by `KEEPING` nats.
        """
        score = self._score.copy()
        if near is not None:
            turn = np.arange(len(score)) + 0.5 - near * len(score) / (2 * math.pi)
            apart = np.abs((turn + len(score) / 2) % len(score) - len(score) / 2)
            score[apart <= FASTEST] += KEEPING
        angle, speed = np.unravel_index(score.argmax(), score.shape)
        count, bins = len(self._steps), len(self._score)
        path, place = np.empty(count), int(angle)
        for frame in range(count - 1, -1, -1):
            path[frame] = place
            if frame:
                place -= int(SPEEDS[speed])
                speed = self._steps[frame][place % bins, speed]
        centres: np.ndarray = (path + 0.5) * (2 * math.pi / bins)
        return centres


def smooth(
    values: np.ndarray,
    deviation: np.ndarray,
    acceleration: float | np.ndarray,
    speed: float | np.ndarray = math.inf,
) -> np.ndarray:
    """Smooth measurements of frames: Rauch, Tung and Striebel's smoother of a place with its speed.

    Single measurements may be far off: their noise is Student's, by iterated reweighting.

    Args:
        values: (..., T) measurements.
        deviation: (..., T) its standard deviations; inf where nothing was.
        acceleration: (...) standard deviation of the change of speed from a frame to the next.
        speed: (...) standard deviation of the speed in the first frame, at most 100 times that.

    Returns:
        (2, ..., T) means and standard deviations; without any measurement 0 and inf.
    """
    measured = np.isfinite(deviation)
    nothing = ~measured.any(-1, keepdims=True)
    variance = np.where(measured, deviation, 1.0) ** 2
    measured, weight = measured | nothing, np.ones(values.shape)
    # 4: rounds of reweighting, after which weights hardly change
    for _ in range(4):
        estimate = _smooth_gaussian(
            values, np.where(measured, variance / weight, math.inf), acceleration, speed
        )
        weight = (TAILS + 1) / (TAILS + (values - estimate[0]) ** 2 / variance)
    return np.where(nothing, np.reshape([0.0, math.inf], (2, *[1] * values.ndim)), estimate)


def _smooth_gaussian(
    values: np.ndarray,
    variance: np.ndarray,
    acceleration: float | np.ndarray,
    speed: float | np.ndarray = math.inf,
) -> np.ndarray:
    """Smooth by `smooth` with Gaussian noise of such variances (..., T)."""
    change = np.broadcast_to(np.square(acceleration), values.shape[:-1])
    step = np.array([[1.0, 1.0], [0.0, 1.0]])
    noise = change[..., None, None] * np.array([[1 / 3, 1 / 2], [1 / 2, 1.0]])
    first = np.isfinite(variance).argmax(-1)[..., None]
    mean, spread = np.zeros((*change.shape, 2)), np.zeros((*change.shape, 2, 2))
    mean[..., :1] = np.take_along_axis(values, first, -1)
    spread[..., 0, 0] = 1e6 * np.take_along_axis(variance, first, -1)[..., 0]
    spread[..., 1, 1] = np.minimum(np.square(speed), 1e4 * change)
    means: list[np.ndarray] = []
    spreads: list[np.ndarray] = []
    predicted: list[tuple[np.ndarray, np.ndarray]] = []
    for value, error in zip(np.moveaxis(values, -1, 0), np.moveaxis(variance, -1, 0), strict=True):
        if means:
            mean, spread = mean @ step.T, step @ spread @ step.T + noise
        predicted.append((mean, spread))
        gain = spread[..., 0] / (spread[..., 0, 0] + error)[..., None]
        mean = mean + gain * (value - mean[..., 0])[..., None]
        spread = spread - gain[..., None] * spread[..., None, 0, :]
        means.append(mean)
        spreads.append(spread)
    uncertain = np.array([each for _, each in predicted[1:]]).reshape(-1, *spread.shape)
    backs = np.array(spreads[:-1]).reshape(uncertain.shape) @ step.T @ np.linalg.inv(uncertain)
    for frame in range(len(means) - 2, -1, -1):
        back, (ahead, spread) = backs[frame], predicted[frame + 1]
        means[frame] = means[frame] + (back @ (means[frame + 1] - ahead)[..., None])[..., 0]
        spreads[frame] = spreads[frame] + back @ (spreads[frame + 1] - spread) @ back.swapaxes(-1, -2)
    deviations = np.sqrt(np.maximum([each[..., 0, 0] for each in spreads], 0.0))
    return np.stack([np.moveaxis(np.array(each), 0, -1) for each in ([m[..., 0] for m in means], deviations)])
