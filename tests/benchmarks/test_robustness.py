"""Strange scenes; `python -m benchmarks.robustness` tries 10,000."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from benchmarks.robustness import try_scenes
from vig.likelihood import ROBUST, Likelihood, Photos
from vig.likelihood.kernels.geometry import Geometry
from vig.renderer import rasterize
from vig.scene import EXPOSURE_L00, Camera, Latents, ObjectClass


def test_strange_scenes_give_finite_numbers() -> None:
    tally = try_scenes(400, seed=1)
    assert (tally.tried, tally.broken) == (400, 0)
    assert tally.seen > 80  # they are not strange for being empty alone


def front_view(teapot: ObjectClass) -> torch.Tensor:
    """The mean teapot from its side (1, P')."""
    light = torch.zeros(1, 9)
    light[:, 0] = EXPOSURE_L00
    angle = torch.zeros(1)
    latents = Latents(
        torch.zeros(1, teapot.shape_model.modes), angle, angle + 0.4, torch.full((1, 3), 0.5), light
    )
    return torch.cat([latents.to_vector(), torch.zeros(1, 3)], 1)


def covered_share(teapot: ObjectClass, size: int) -> float:
    """How much of an image `front_view` covers, by the centres of its pixels."""
    camera = Camera.standard(size, teapot.target_height)
    pose = (part[0].numpy() for part in camera.pose(torch.zeros(1), torch.zeros(1) + 0.4))
    model = teapot.shape_model
    return float((rasterize(model.mean, model.faces, *pose, camera, cull=True).face >= 0).mean())


@pytest.mark.parametrize("size", [1, 2, 17, 1024, 4096])
def test_an_image_may_have_any_size(teapot: ObjectClass, size: int) -> None:
    """The covered share of the image is the rasteriser's, at every size that resolves it."""
    camera = Camera.standard(size, teapot.target_height)
    photo = torch.full((1, size, size, 3), 0.4)
    likelihood = Likelihood(
        Geometry(teapot.shape_model), camera, Photos(photo, ROBUST.log_prior(size, size)[None])
    )
    found = likelihood.at(
        front_view(teapot), torch.zeros(1, dtype=torch.int32), torch.full((1,), 0.03), images=True
    )
    for name in ("value", "gradient", "normal", "posterior", "coverage", "irradiance"):
        assert torch.isfinite(getattr(found, name)).all(), name
    if size > 16:
        share = covered_share(teapot, 700)
        assert found.coverage.mean().item() == pytest.approx(share, rel=0.06 if size < 100 else 0.002)


def test_a_mesh_whose_faces_are_all_degenerate_covers_nothing(teapot: ObjectClass) -> None:
    model = replace(teapot.shape_model, faces=teapot.shape_model.faces[:50][:, [0, 0, 1]])
    camera = Camera.standard(60, teapot.target_height)
    photo = torch.full((1, 60, 60, 3), 0.4)
    likelihood = Likelihood(Geometry(model), camera, Photos(photo, ROBUST.log_prior(60, 60)[None]))
    found = likelihood.at(
        front_view(teapot), torch.zeros(1, dtype=torch.int32), torch.full((1,), 0.03), images=True
    )
    assert found.value.item() == 0 and not found.coverage.any() and not found.gradient.any()
