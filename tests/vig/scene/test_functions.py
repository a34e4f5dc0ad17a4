"""Scenes' functions take arrays and, of a caller who has torch, tensors, by which they are differentiated."""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch

from tests.support import assert_close
from tests.toys import toy
from vig.photo.images import as_photo
from vig.scene import (
    Camera,
    Latents,
    Symmetry,
    angle_difference,
    irradiance,
    linear_from_srgb,
    rotate_z,
    rotations_z,
    sh_basis,
    srgb_from_linear,
)

FIN = toy("fin")
TURNED = replace(Camera.standard(target_height=0.08), roll=0.3, mount=tuple(map(tuple, np.eye(4))))
FUNCTIONS: dict[str, Callable[[Latents], Any]] = {
    "vector": lambda latents: latents.to_vector(),
    "vertices": lambda latents: FIN.shape_model.vertices(latents.shape),
    "rotation": lambda latents: Camera.standard().pose(latents.azimuth, latents.elevation)[0],
    "translation": lambda latents: TURNED.pose(latents.azimuth, latents.elevation)[1],
    "difference": lambda latents: angle_difference(latents.azimuth, latents.elevation),
    "canonical": lambda latents: Symmetry.HALF_TURN.canonical(latents).to_vector(),
    "linear": lambda latents: linear_from_srgb(latents.albedo),
    "srgb": lambda latents: srgb_from_linear(latents.albedo),
    "basis": lambda latents: sh_basis(latents.albedo),
    "irradiance": lambda latents: irradiance(latents.light, latents.albedo),
    "light": lambda latents: rotate_z(latents.light, latents.azimuth),
    "turns": lambda latents: rotations_z(latents.azimuth),
}


@pytest.fixture
def vector() -> np.ndarray:
    """Latents (4, 17), azimuths all round."""
    rng = np.random.default_rng(0)
    numbers = np.concatenate([rng.normal(size=(4, 3)), rng.uniform(0.1, 0.9, (4, 14))], axis=1)
    numbers[:, 3] += [0, -math.pi, 1.5 * math.pi, 10]
    return numbers


@pytest.mark.parametrize("name", FUNCTIONS)
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_tensors_give_what_arrays_give(name: str, dtype: type, vector: np.ndarray) -> None:
    numbers = vector.astype(dtype)
    found = FUNCTIONS[name](Latents.from_vector(torch.from_numpy(numbers)))
    assert_close(found.numpy(), FUNCTIONS[name](Latents.from_vector(numbers)))


@pytest.mark.parametrize("name", FUNCTIONS)
def test_tensors_are_differentiated(name: str, vector: np.ndarray) -> None:
    point = torch.tensor(vector, requires_grad=True)
    assert torch.autograd.gradcheck(lambda at: FUNCTIONS[name](Latents.from_vector(at)), point)


class Picture(np.ndarray):
    """An array as imageio gives them: of a class and module of its own."""


def test_numbers_of_any_kind_are_taken_as_what_they_are() -> None:
    light = np.arange(9)
    np.testing.assert_array_equal(rotate_z(light, 0.5), rotate_z(light.astype(float), 0.5))
    assert linear_from_srgb(1.0) == linear_from_srgb([1])[0] == 1
    assert np.allclose(srgb_from_linear(np.ones(2).view(Picture)), 1)
    assert as_photo(torch.nn.Parameter(torch.full((20, 20, 3), 0.5))).max() == 0.5
