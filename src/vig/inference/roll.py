"""Whether a photo looks as if the camera had been rolled about its axis, which no latent can express.

A fit of such a photo is one that a small roll would better. It need not be fitted anew: what was rendered is
rolled as a picture.
"""

from __future__ import annotations

import math

import torch
from torch.nn import functional

from vig.likelihood import mixture

ROLL = math.radians(8.0)
"""How far a fit is rolled, either way."""
SIGMA = 0.05
"""Noise under which the rolled fit is compared, linear RGB: wider than a fit's, as details no longer meet."""
MORE = 50
"""Pixels counted as seen beside those that are, so that few do not say much."""


def roll_gain(
    rendered: torch.Tensor,
    coverage: torch.Tensor,
    observed: torch.Tensor,
    log_prior: torch.Tensor,
    pixels: int,
) -> float:
    """Nats for each visible pixel by which a fit explains its photo better, or worse, rolled by `ROLL`.

    The better of both ways counts. rendered, observed (H, W, 3) linear RGB, coverage (H, W) in [0, 1],
    log_prior (H, W, 3) as `PixelModel.log_prior`; pixels: how many of the object are seen.
    """
    picture = torch.cat([rendered * coverage[..., None], coverage[..., None]], -1).permute(2, 0, 1)[None]

    def value(shown: torch.Tensor) -> float:
        covered = shown[3].clamp(0, 1)
        colour = (shown[:3] / shown[3].clamp_min(0.05)).permute(1, 2, 0)
        explained, _ = mixture(observed, colour, log_prior, SIGMA)
        return float((covered * explained + (1 - covered) * log_prior[..., 2]).sum(dtype=torch.float64))

    level = value(picture[0])
    rolled = [value(_rolled(picture, angle)[0]) for angle in (-ROLL, ROLL)]
    return (max(rolled) - level) / (pixels + MORE)


def _rolled(picture: torch.Tensor, angle: float) -> torch.Tensor:
    """A picture (1, C, H, W) of any size rolled about its centre; nothing comes in at the corners."""
    height, width = picture.shape[2:]
    cos, sin = math.cos(angle), math.sin(angle)
    # In units of half the height and half the width, which need not be the same.
    matrix = picture.new_tensor([[cos, -sin * height / width, 0], [sin * width / height, cos, 0]])
    grid = functional.affine_grid(matrix[None], list(picture.shape), align_corners=False)
    return functional.grid_sample(picture, grid, align_corners=False)
