"""Explanations as pictures: what the renderer makes of latents in the standard camera."""

from __future__ import annotations

import numpy as np
import torch

from vig.inference import geometry_of
from vig.likelihood import ROBUST, Likelihood, Photos
from vig.scene import Camera, Latents, ObjectClass


def rendered(
    latents: Latents, object_class: ObjectClass, self_shadow: bool = False
) -> tuple[np.ndarray, np.ndarray]:
    """Colour (N, H, W, 3), linear RGB, and coverage (N, H, W) in [0, 1] of N explanations."""
    camera = Camera.standard(target_height=object_class.target_height)
    blank = torch.zeros(1, camera.height, camera.width, 3)
    log_prior = ROBUST.log_prior(camera.height, camera.width)[None]
    likelihood = Likelihood(geometry_of(object_class, self_shadow), camera, Photos(blank, log_prior))
    colours, coverages = [], []
    for part in latents.to_vector().float().split(16):
        count = len(part)
        seen = likelihood(
            Latents.from_vector(part),
            torch.zeros(count, 3),
            torch.zeros(count, dtype=torch.int32),
            torch.full((count,), ROBUST.sigma),
            derivatives=False,
        )
        assert seen.coverage is not None and seen.irradiance is not None
        albedo = Latents.from_vector(part).albedo
        colours.append((seen.irradiance[..., None] * albedo[:, None, None, :]).numpy())
        coverages.append(seen.coverage.numpy())
    return np.concatenate(colours), np.concatenate(coverages)


def silhouettes(latents: Latents, object_class: ObjectClass) -> np.ndarray:
    """Whole silhouettes (N, H, W) bool of N explanations."""
    return rendered(latents, object_class)[1] >= 0.5
