"""A block of latents of one's own: what fits move follows from the layout alone."""

from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest

from vig.inference import Objective
from vig.likelihood import Evaluation
from vig.scene import LatentLayout, Latents, ObjectClass
from vig.scene.latents import Block, point_layout
from vig.search import Budget, LevenbergMarquardt

ROLL = Block("roll", 1, -1.0, 1.0, deviation=0.5)
LANDMARKS = np.array([[1.0, 0.2], [-0.8, 0.3], [0.0, 1.0], [0.1, -0.6]])
"""A spout, a handle, a lid and a foot, seen from the side."""


@dataclass(frozen=True)
class Toy:
    """The likelihood of seen landmarks (4, 2): azimuth shortens them sideways, roll turns them."""

    layout: LatentLayout
    seen: np.ndarray
    geometry = SimpleNamespace(dtype=np.float64)

    def residual(self, points: np.ndarray) -> np.ndarray:
        """Residuals (..., 8) of points (..., P')."""
        part = self.layout.split(points)
        cos, sin = np.cos(part["roll"]), np.sin(part["roll"])
        x, y = np.cos(part["azimuth"]) * LANDMARKS[:, 0], LANDMARKS[:, 1]
        turned = np.stack([x * cos - y * sin, x * sin + y * cos], axis=-1)
        if "framing" in self.layout:
            turned = turned + part["framing"][..., None, :2]
        return (turned - self.seen).reshape(*points.shape[:-1], -1)

    def at(
        self,
        points: np.ndarray,
        photo: np.ndarray,
        sigma: np.ndarray,
        derivatives: bool = True,
        images: bool = False,
    ) -> Evaluation:
        residual = self.residual(points) / sigma[:, None]
        # (B, P', 8): the imaginary part of a small imaginary step is the derivative, exactly.
        steps = 1e-20j * np.eye(points.shape[1])
        slope = self.residual(points[:, None] + steps).imag / 1e-20 / sigma[:, None, None]
        gradient = -(slope @ residual[..., None])[..., 0]
        value = -0.5 * (residual**2).sum(1)
        return Evaluation(value, gradient, slope @ slope.swapaxes(1, 2), None, None, None)


def seen(roll: float, azimuth: float = 0.5) -> np.ndarray:
    """The landmarks of a truth."""
    toy = Toy(point_layout(2).with_blocks(ROLL), np.zeros((4, 2)))
    point = np.zeros(toy.layout.size)
    point[toy.layout["roll"]], point[toy.layout["azimuth"]] = roll, azimuth
    return toy.residual(point).reshape(4, 2)


def searched(layout: LatentLayout, object_class: ObjectClass, roll: float) -> tuple[Objective, np.ndarray]:
    """The objective of landmarks that were rolled, and where a descent from an even pose ends (P',)."""
    objective = Objective(Toy(layout, seen(roll)), object_class)
    start = replace(
        Latents.from_vector(np.zeros((1, layout.count("shape") + 14))),
        azimuth=np.array([0.3]),
        light=object_class.light_prior_mean[None],
    )
    photo = np.zeros(1, np.int32)
    found = LevenbergMarquardt()(objective, objective.point(start), photo, 0.01, Budget(50, 1e-6))
    assert found.converged.all()
    return objective, found.points[0]


@pytest.mark.parametrize("roll", [-0.4, 0.3])
def test_a_block_of_ones_own_is_found_by_the_real_objective_and_optimiser(
    roll: float, teapot: ObjectClass
) -> None:
    layout = point_layout(2).with_blocks(ROLL)
    objective, point = searched(layout, teapot, roll)
    assert point[layout["roll"]] == pytest.approx(roll, abs=1e-3)
    assert objective.latents(point[None]).azimuth == pytest.approx(0.5, abs=1e-3)
    assert not point[layout["framing"]].any(), "held unless it is asked for"


def test_a_layout_without_a_block_is_fitted_without_it(teapot: ObjectClass) -> None:
    layout = point_layout(2).without("framing").with_blocks(ROLL)
    objective, point = searched(layout, teapot, 0.3)
    assert len(point) == point_layout(2).size - 4 + 1
    assert point[layout["roll"]] == pytest.approx(0.3, abs=1e-3)
    assert objective.framing(point[None]).tolist() == [[0, 0, 0, 0]]


def test_a_held_block_stays_where_it_is_held(teapot: ObjectClass) -> None:
    layout = point_layout(2).with_blocks(ROLL.hold(0.1))
    objective, point = searched(layout, teapot, 0.3)
    assert point[layout["roll"]] == 0.1
    free = searched(point_layout(2).with_blocks(ROLL), teapot, 0.3)[0]
    photo, sigma = np.zeros(1, np.int32), np.array([0.01])
    off = free.likelihood.at(point[None], photo, sigma).value
    assert objective(point[None], photo, sigma).value < -10 and off < -10, "a roll of 0.3 is out of reach"


@pytest.mark.parametrize(("weighted", "nats"), [(True, 3.5), (False, 0.5)])
def test_a_blocks_own_prior_counts_by_its_deviation_and_weight(
    weighted: bool, nats: float, teapot: ObjectClass
) -> None:
    """Half a nat at one deviation; times the weight of 7 of the prior unless the block is not weighted."""
    layout = point_layout(2).with_blocks(replace(ROLL, weighted=weighted))
    prior = Objective(Toy(layout, seen(0.0)), teapot, prior_weight=7.0).prior
    points = np.zeros((2, layout.size))
    points[1, layout["roll"]] = 0.5
    value = prior.value(points)
    assert value[0] - value[1] == pytest.approx(nats)
