"""A block of latents of one's own: what fits move follows from the layout alone."""

from __future__ import annotations

from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from tests.tensors import arrays, wrap
from vig.inference import Objective
from vig.likelihood import Evaluation
from vig.scene import LatentLayout, Latents, ObjectClass
from vig.scene.latents import Block, point_layout
from vig.search import Budget, LevenbergMarquardt

Objective, Evaluation, LevenbergMarquardt = map(wrap, (Objective, Evaluation, LevenbergMarquardt))


ROLL = Block("roll", 1, -1.0, 1.0, deviation=0.5)
LANDMARKS = torch.tensor([[1.0, 0.2], [-0.8, 0.3], [0.0, 1.0], [0.1, -0.6]], dtype=torch.float64)
"""A spout, a handle, a lid and a foot, seen from the side."""


@dataclass(frozen=True)
class Toy:
    """The likelihood of seen landmarks (4, 2): azimuth shortens them sideways, roll turns them."""

    layout: LatentLayout
    seen: torch.Tensor
    geometry = SimpleNamespace(dtype=np.float64)

    def residual(self, point: torch.Tensor) -> torch.Tensor:
        part = self.layout.split(torch.as_tensor(point))
        roll, shorter = part["roll"][0], torch.cos(part["azimuth"][0])
        x, y = shorter * LANDMARKS[:, 0], LANDMARKS[:, 1]
        turned = torch.stack([x * roll.cos() - y * roll.sin(), x * roll.sin() + y * roll.cos()], dim=1)
        if "framing" in self.layout:
            turned = turned + part["framing"][:2]
        return (turned - torch.as_tensor(self.seen)).flatten()

    def at(
        self,
        points: torch.Tensor,
        photo: torch.Tensor,
        sigma: torch.Tensor,
        derivatives: bool = True,
        images: bool = False,
    ) -> Evaluation:
        points, sigma = (torch.as_tensor(each) for each in (points, sigma))
        residual = torch.stack([self.residual(point) for point in points]) / sigma[:, None]
        slope = torch.stack([torch.autograd.functional.jacobian(self.residual, p) for p in points])
        slope = slope / sigma[:, None, None]
        gradient = -(residual[:, None] @ slope)[:, 0]
        value = -0.5 * (residual**2).sum(1)
        return arrays(Evaluation(value, gradient, slope.mT @ slope, None, None, None))


def seen(roll: float, azimuth: float = 0.5) -> torch.Tensor:
    """The landmarks of a truth."""
    toy = Toy(point_layout(2).with_blocks(ROLL), torch.zeros(4, 2, dtype=torch.float64))
    point = torch.zeros(toy.layout.size, dtype=torch.float64)
    point[toy.layout["roll"]], point[toy.layout["azimuth"]] = roll, azimuth
    return toy.residual(point).view(4, 2)


def searched(layout: LatentLayout, object_class: ObjectClass, roll: float) -> tuple[Objective, torch.Tensor]:
    """The objective of landmarks that were rolled, and where a descent from an even pose ends (P',)."""
    objective = Objective(Toy(layout, seen(roll)), object_class)
    light = torch.from_numpy(object_class.light_prior_mean)[None].double()
    start = replace(
        Latents.from_vector(torch.zeros(1, layout.count("shape") + 14, dtype=torch.float64)),
        azimuth=torch.tensor([0.3], dtype=torch.float64),
        light=light,
    )
    photo = torch.zeros(1, dtype=torch.int32)
    found = LevenbergMarquardt()(objective, objective.point(start), photo, 0.01, Budget(50, 1e-6))
    assert found.converged.all()
    return objective, found.points[0]


@pytest.mark.parametrize("roll", [-0.4, 0.3])
def test_a_block_of_ones_own_is_found_by_the_real_objective_and_optimiser(
    roll: float, teapot: ObjectClass
) -> None:
    layout = point_layout(2).with_blocks(ROLL)
    objective, point = searched(layout, teapot, roll)
    assert float(point[layout["roll"]]) == pytest.approx(roll, abs=1e-3)
    assert float(objective.latents(point[None]).azimuth) == pytest.approx(0.5, abs=1e-3)
    assert not point[layout["framing"]].any(), "held unless it is asked for"


def test_a_layout_without_a_block_is_fitted_without_it(teapot: ObjectClass) -> None:
    layout = point_layout(2).without("framing").with_blocks(ROLL)
    objective, point = searched(layout, teapot, 0.3)
    assert len(point) == point_layout(2).size - 4 + 1
    assert float(point[layout["roll"]]) == pytest.approx(0.3, abs=1e-3)
    assert objective.framing(point[None]).tolist() == [[0, 0, 0, 0]]


def test_a_held_block_stays_where_it_is_held(teapot: ObjectClass) -> None:
    layout = point_layout(2).with_blocks(ROLL.held(0.1))
    objective, point = searched(layout, teapot, 0.3)
    assert float(point[layout["roll"]]) == 0.1
    free = searched(point_layout(2).with_blocks(ROLL), teapot, 0.3)[0]
    photo, sigma = torch.zeros(1, dtype=torch.int32), torch.tensor([0.01], dtype=torch.float64)
    off = free.likelihood.at(point[None], photo, sigma).value
    assert objective(point[None], photo, sigma).value < -10 and off < -10, "a roll of 0.3 is out of reach"


@pytest.mark.parametrize(("weighted", "nats"), [(True, 3.5), (False, 0.5)])
def test_a_blocks_own_prior_counts_by_its_deviation_and_weight(
    weighted: bool, nats: float, teapot: ObjectClass
) -> None:
    """Half a nat at one deviation; times the weight of 7 of the prior unless the block is not weighted."""
    layout = point_layout(2).with_blocks(replace(ROLL, weighted=weighted))
    prior = Objective(Toy(layout, seen(0.0)), teapot, prior_weight=7.0).prior
    points = torch.zeros(2, layout.size, dtype=torch.float64)
    points[1, layout["roll"]] = 0.5
    value = prior.value(points)
    assert float(value[0] - value[1]) == pytest.approx(nats)
