"""Light and albedo in closed form: on a bilinear problem, and on a photo whose geometry is known."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import torch

from vig.inference import Objective
from vig.likelihood import ROBUST
from vig.optimizers.closed_form import Alternating, ClosedForm
from vig.optimizers.levenberg_marquardt import LevenbergMarquardt
from vig.optimizers.optimizer import Budget
from vig.scene import EXPOSURE_L00, ObjectClass

NONE = torch.zeros(1, dtype=torch.int64)
FIRST, SECOND = slice(0, 3), slice(3, 5)


@pytest.fixture(scope="module")
def basis() -> torch.Tensor:
    return torch.from_numpy(np.random.default_rng(0).normal(size=(20, 3)))


def bilinear(least_squares, basis: torch.Tensor, colours: torch.Tensor, inliers: float = 1.0):
    """Colours (20, 2) should be (basis l) a, where l is the first three of six parameters, a the next two."""

    def residuals(z: torch.Tensor) -> torch.Tensor:
        shown = (z[..., :3] @ basis.T)[..., None] * z[..., None, 3:5]
        return torch.cat([(shown - colours).flatten(-2), z[..., 5:]], dim=-1)

    infinity = math.inf
    return least_squares(
        residuals,
        [-infinity] * 3 + [0.0] * 2 + [-infinity],
        [infinity] * 3 + [1.0] * 2 + [infinity],
        inliers,
    )


def row(*numbers: float) -> torch.Tensor:
    return torch.tensor([numbers], dtype=torch.float64)


def test_one_step_solves_one_block_and_leaves_the_others(least_squares, basis: torch.Tensor) -> None:
    colours = torch.from_numpy(np.random.default_rng(1).normal(size=(20, 2)))
    problem = bilinear(least_squares, basis, colours)
    start = row(0.0, 0.0, 0.0, 0.4, 0.9, 2.0)
    end = ClosedForm((FIRST,))(problem, start, NONE, 0.1, Budget(1))
    design = torch.cat([0.4 * basis, 0.9 * basis])
    solution = torch.linalg.lstsq(design, colours.T.flatten()[:, None]).solution[:, 0]
    torch.testing.assert_close(end.points[0, :3], solution)
    assert torch.equal(end.points[0, 3:], start[0, 3:])
    assert end.evaluations.item() == 2
    both = ClosedForm((FIRST, SECOND))
    once, twice = (both(problem, start, NONE, 0.1, Budget(count, 0.0)).points for count in (1, 2))
    torch.testing.assert_close(once, end.points)
    assert torch.equal(twice[:, FIRST], once[:, FIRST]) and not torch.equal(twice[:, SECOND], once[:, SECOND])


def test_albedo_rests_on_its_bound(least_squares, basis: torch.Tensor) -> None:
    light = torch.tensor([1.0, -0.5, 0.3], dtype=torch.float64)
    problem = bilinear(least_squares, basis, (basis @ light)[:, None] * torch.tensor([1.3, 0.6]))
    start = torch.cat([light[None], row(0.2, 0.2, 0.0)], dim=1)
    end = ClosedForm((SECOND,))(problem, start, NONE, 0.1, Budget(1))
    torch.testing.assert_close(end.points[0, 3:5], torch.tensor([1.0, 0.6]).double())


def test_blocks_in_turn_find_both_behind_outliers(least_squares, basis: torch.Tensor) -> None:
    """Only the product of light and albedo is seen: their ratio stays where the start has it."""
    light, albedo = torch.tensor([1.0, -0.5, 0.3]).double(), torch.tensor([0.8, 0.4]).double()
    colours = (basis @ light)[:, None] * albedo
    colours[:3] += 1.5
    problem = bilinear(least_squares, basis, colours, inliers=0.8)
    start = row(0.9, -0.4, 0.2, 0.7, 0.5, 0.0)
    end = ClosedForm((FIRST, SECOND))(problem, start, NONE, 0.1, Budget(20, 1e-6))
    product = end.points[0, :3, None] * end.points[0, 3:5]
    torch.testing.assert_close(product, light[:, None] * albedo, atol=2e-3, rtol=0)
    assert end.converged.item() and end.evaluations.item() < 21


@pytest.fixture(scope="module")
def shown(studio, teapot: ObjectClass):
    """An objective of an occluded photo, a start that knows only its geometry, and the value at the truth."""
    rng = np.random.default_rng(4)
    truth = studio.latents(rng)
    objective = Objective(studio.likelihood(studio.photo(rng, truth, noise=0.01)), teapot)
    light = torch.zeros_like(truth.light)
    light[:, 0] = EXPOSURE_L00
    grey = replace(truth, albedo=torch.full_like(truth.albedo, 0.5), light=light)
    best = objective(objective.point(truth), *studio.whose(1)).value.item()
    return objective, objective.point(grey), best


def test_a_photos_light_and_albedo_are_found_given_its_geometry(studio, shown) -> None:
    objective, start, best = shown
    before = objective(start, *studio.whose(1)).value.item()
    # As a start before a descent: at wide noise nothing is an outlier yet.
    wide = ClosedForm()(objective, start, studio.whose(1)[0], 4 * ROBUST.sigma, Budget(20))
    end = ClosedForm()(objective, wide.points, studio.whose(1)[0], ROBUST.sigma, Budget(40))
    assert before < best - 1000
    assert end.value.item() > best - 20
    still = [*range(12), *range(24, 27)]
    assert torch.equal(end.points[0, still], start[0, still])
    assert (end.points >= objective.lower).all() and (end.points <= objective.upper).all()


def test_a_closed_form_first_is_a_descent_from_its_end(studio, shown) -> None:
    objective, start, _ = shown
    photo = studio.whose(1)[0]
    begun = ClosedForm()(objective, start, photo, ROBUST.sigma, Budget(4))
    apart = LevenbergMarquardt()(objective, begun.points, photo, ROBUST.sigma, Budget(6))
    joined = Alternating(LevenbergMarquardt(), descended=99)(
        objective, start, photo, ROBUST.sigma, Budget(10)
    )
    assert torch.equal(joined.points, apart.points) and joined.value == apart.value
    assert joined.evaluations == begun.evaluations + apart.evaluations


def test_turns_gain_and_keep_to_their_budget(studio, shown, watch) -> None:
    objective, start, _ = shown
    photo = studio.whose(1)[0]
    values = []
    for iterations in (0, 5, 12, 24):
        watched = watch(objective)
        end = Alternating(LevenbergMarquardt())(watched, start, photo, ROBUST.sigma, Budget(iterations))
        assert end.evaluations.item() == watched.counted(1).item() <= iterations + 2 * (1 + iterations // 12)
        assert end.value.item() == watched.best[0]
        values.append(end.value.item())
    assert values == sorted(values) and values[-1] > values[0] + 1000
    end = Alternating(LevenbergMarquardt())(objective, start, photo, ROBUST.sigma, Budget(200, 1.0))
    assert end.converged.item()


def test_a_start_without_a_value_ends_there(least_squares) -> None:
    problem = least_squares(lambda z: z, [-math.inf] * 2, [math.inf] * 2, outside=lambda z: z[:, 0] < 0)
    starts = torch.tensor([[-1.0, 1.0], [3.0, 1.0]], dtype=torch.float64)
    blocks = ClosedForm((slice(0, 1), slice(1, 2)))
    for optimizer in (blocks, Alternating(LevenbergMarquardt(), blocks)):
        end = optimizer(problem, starts, torch.arange(2), 1.0, Budget(20))
        assert torch.equal(end.points[0], starts[0]) and end.converged.tolist() == [False, True]
        assert end.value[1] > -1e-3
