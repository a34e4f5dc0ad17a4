"""The native step of Levenberg-Marquardt beside plain algebra."""

import math
from typing import Any

import numpy as np
import pytest

from vig_native import engine


def _plain_step(x: Any, slope: Any, curved: Any, damping: float, low: Any, high: Any) -> Any:
    """One damped step in numpy: solved with numbers at a bound held, three times at most."""
    diagonal = curved.diagonal()
    floor = 1e-6 * diagonal.max()
    held = ((x <= low) & (slope <= 0)) | ((x >= high) & (slope >= 0)) | (low == high)
    step = np.zeros_like(x)
    for _ in range(3):
        free = np.flatnonzero(~held)
        matrix = curved + np.diag(damping * (diagonal + floor) + 1e-9 * floor)
        right = slope - curved @ np.where(held, step, 0)
        step[free] = np.linalg.solve(matrix[np.ix_(free, free)], right[free])
        over = ~held & ((x + step < low) | (x + step > high))
        step = np.clip(x + step, low, high) - x
        if not over.any():
            break
        held |= over
    return step


def _step(x: Any, slope: Any, curved: Any, damping: float, low: Any, high: Any) -> Any:
    """Return the first step of a search, which gains whatever it is."""
    values = iter([0.0, 1.0])
    path, *_ = engine.search_function(
        lambda point, derivatives: (next(values), slope, curved), x[None], low, high, 1, 0.0, damping, 1e4
    )
    return path[1, 0] - x


@pytest.mark.parametrize("damping", [1.0, 0.01])
def test_a_damped_step_is_that_of_plain_algebra(damping: float) -> None:
    rng = np.random.default_rng(0)
    size = 34
    low, high = np.full(size, -1.0), np.full(size, 1.0)
    low[3] = high[3] = 0.2
    met = set()
    for _ in range(40):
        point = rng.uniform(-1, 1, size).clip(low, high)
        point[5], point[6] = -1.0, 1.0
        root, slope = rng.normal(size=(size + 3, size)), 30 * rng.normal(size=size)
        curved = root.T @ root
        step = _step(point, slope, curved, damping, low, high)
        np.testing.assert_allclose(step, _plain_step(point, slope, curved, damping, low, high), atol=1e-9)
        met |= set(np.sign((point + step - low) * (high - point - step)).tolist())
    assert met >= {0.0, 1.0}, "bounds are met, and not by all numbers"


def test_a_step_is_short_where_the_matrix_is_not_positive() -> None:
    normal, bound = np.array([[4.0, 9.0], [9.0, 4.0]]), np.full(2, 9.0)
    step = _step(np.zeros(2), np.array([4.0, 8.0]), normal, 0.0, -bound, bound)
    np.testing.assert_allclose(step, [0.1, 0.2], rtol=1e-5)


@pytest.mark.parametrize("gain", [-3.0, 0.2, 2.0, 20.0, math.nan])
@pytest.mark.parametrize("finite", [True, False])
def test_a_step_that_gains_is_taken_and_damping_is_nielsens(gain: float, finite: bool) -> None:
    """One number, slope and curvature 1: a step from damping d is 1 / (1 + d), which the second one tells.

    A trial whose gradient is not finite never gains.
    """
    calls: list[float] = []

    def value_point(point: np.ndarray, derivatives: bool) -> tuple[float, np.ndarray, np.ndarray]:
        calls.append(float(point[0]))
        slope = math.nan if len(calls) == 2 and not finite else 1.0
        return (0.0, gain, -9.0)[len(calls) - 1], np.array([slope]), np.ones((1, 1))

    starts, bound, damping = np.zeros((1, 1)), np.full(1, 9.0), 0.5
    path, value, *_ = engine.search_function(value_point, starts, -bound, bound, 2, 0.01, damping, 1e4)
    step = 1 / (1 + damping)
    promised, taken = step - step**2 / 2, gain > 0 and finite
    shrink = min(max(1 - (2 * gain / promised - 1) ** 3, 1 / 3), 2) if taken else 3.0
    assert calls[1] == pytest.approx(step, rel=1e-5)
    assert calls[2] == pytest.approx(step * taken + 1 / (1 + damping * shrink), rel=1e-5)
    assert path[1, 0, 0] == (calls[1] if taken else 0) and value[0] == (gain if taken else 0)


def test_a_search_ends_where_a_step_gains_little_or_nothing_is_promised() -> None:
    def value_point(point: np.ndarray, derivatives: bool) -> tuple[float, np.ndarray, np.ndarray]:
        return float(-50 * (point[0] - 1) ** 2), -100 * (point - 1), np.full((1, 1), 100.0)

    starts, bound = np.array([[0.0], [1.0]]), np.full(1, 9.0)
    path, value, _, evaluations, converged = engine.search_function(
        value_point, starts, -bound, bound, 30, 0.1, 0.1, 1e4
    )
    assert converged.all() and evaluations[0] < 8 and value == pytest.approx([0, 0], abs=0.05)
    assert path[-1, :, 0] == pytest.approx([1, 1], abs=0.05)
