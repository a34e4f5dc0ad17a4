"""The native step of Levenberg-Marquardt beside plain algebra."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, cast

import numpy as np
import pytest
import torch

from vig.inference.objective import ObjectiveValue
from vig.search.damped_step import Standing, damped_step


@dataclass(frozen=True)
class _Bounded:
    lower: torch.Tensor
    upper: torch.Tensor


def _plain_step(x: Any, slope: Any, curved: Any, damping: float, low: Any, high: Any) -> tuple[Any, float]:
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
    return step, float((slope - 0.5 * curved @ step) @ step)


@pytest.mark.parametrize("damping", [1.0, 0.01])
def test_a_damped_step_is_that_of_plain_algebra(damping: float) -> None:
    rng = np.random.default_rng(0)
    count, size = 40, 34
    low, high = np.full(size, -1.0), np.full(size, 1.0)
    low[3] = high[3] = 0.2
    points = rng.uniform(-1, 1, (count, size)).clip(low, high)
    points[:, 5], points[:, 6] = -1.0, 1.0
    roots, slopes = rng.normal(size=(count, size + 3, size)), 30 * rng.normal(size=(count, size))
    curved = roots.transpose(0, 2, 1) @ roots
    tensors = (torch.from_numpy(each) for each in (points, slopes, curved))
    problem: Any = _Bounded(torch.from_numpy(low), torch.from_numpy(high))
    step, gain = damped_step(*tensors, torch.full((count,), damping, dtype=torch.float64), problem)
    for index in range(count):
        plain, promised = _plain_step(points[index], slopes[index], curved[index], damping, low, high)
        np.testing.assert_allclose(step[index], plain, atol=1e-9)
        assert float(gain[index]) == pytest.approx(promised, rel=1e-9)
    reached = points + step.numpy()
    assert ((reached > low + 1e-12) & (reached < high - 1e-12)).any() and ((reached == high).any())


def test_a_step_is_short_where_the_matrix_is_not_positive() -> None:
    problem: Any = _Bounded(torch.full((2,), -9.0), torch.full((2,), 9.0))
    normal = torch.tensor([[[4.0, 9.0], [9.0, 4.0]]])
    step, _ = damped_step(torch.zeros(1, 2), torch.tensor([[4.0, 8.0]]), normal, torch.zeros(1), problem)
    torch.testing.assert_close(step, torch.tensor([[0.1, 0.2]]))


@pytest.mark.parametrize("gain", [-3.0, 0.05, 2.0, 20.0, math.nan])
def test_a_step_that_gains_is_taken_and_damping_is_nielsens(gain: float) -> None:
    """Two searches: of the second the gradient that was tried is not finite, so that it never gains."""
    points, step = torch.tensor([[1.0, 2.0], [3.0, 4.0]]), torch.tensor([[0.5, -0.5], [0.25, 0.0]])
    normal = torch.eye(2).repeat(2, 1, 1)
    gradient, value, damping = torch.ones(2, 2), torch.zeros(2, dtype=torch.float64), torch.full((2,), 8.0)
    here = Standing(points.clone(), value, gradient, normal, damping, torch.full((2,), 3.0))
    slopes = torch.tensor([[7.0, 7.0], [7.0, math.nan]])
    tried = ObjectiveValue(torch.full((2,), gain, dtype=torch.float64), slopes, 2 * normal, cast("Any", None))
    done = here.accept(step, torch.full((2,), 4.0, dtype=torch.float64), tried, 0.1, 20.0)
    taken = gain > 0
    shrink = min(max(1 - (2 * gain / 4 - 1) ** 3, 1 / 3), 2) if taken else 3.0
    assert here.damping.tolist() == pytest.approx([8 * shrink, 24])
    assert here.growth.tolist() == [3.0 if taken else 6.0, 6.0]
    assert done.tolist() == [0 < gain < 0.1 or 8 * shrink > 20, True]
    assert torch.equal(here.points, torch.stack([(points + step)[0] if taken else points[0], points[1]]))
    assert here.value.tolist() == [gain if taken else 0.0, 0.0]
    assert here.gradient[0, 0] == (7 if taken else 1) and here.normal[0, 0, 0] == (2 if taken else 1)
    assert here.gradient[1, 0] == 1 and here.normal[1, 0, 0] == 1
