"""Targets of the recognition network, from latents and masks."""

from __future__ import annotations

import math

import torch
from torch.nn import functional

from vig.recognition.network import MASK_STRIDE, layout_of_numbers
from vig.scene import Latents, angle_difference, regressed_layout, rotate_z

_MIRRORED_LIGHT = (3, 4, 7)
"""Heading-frame coefficients odd in x: (1,1), (2,-2), (2,1)."""


def azimuth_labels(azimuth: torch.Tensor, bins: int, spread: float = math.radians(4.0)) -> torch.Tensor:
    """Soft labels (B, bins) of azimuths (B,) radians: a wrapped Gaussian of `spread` radians."""
    centres = (torch.arange(bins, device=azimuth.device) + 0.5) * (2 * math.pi / bins)
    off = angle_difference(azimuth[:, None], centres)
    return torch.softmax(-0.5 * (off / spread) ** 2, dim=1)


def numbers_of(latents: Latents) -> torch.Tensor:
    """The regressed numbers (B, M), see `regressed_layout`; light in the heading frame."""
    light = rotate_z(latents.light, -latents.azimuth)
    parts = {"shape": latents.shape, "elevation": latents.elevation[:, None], "albedo": latents.albedo}
    return regressed_layout(latents.shape.shape[1]).join(parts | {"light": light})


def mirrored(azimuth: torch.Tensor, numbers: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Targets of the photo flipped left to right, for a class that is its own mirror image in y = 0."""
    flipped = numbers.clone()
    first_light = layout_of_numbers(numbers.shape[1]).at("light")
    for coefficient in _MIRRORED_LIGHT:
        flipped[:, first_light + coefficient] *= -1
    return torch.remainder(math.pi - azimuth, 2 * math.pi), flipped


def mask_labels(amodal: torch.Tensor, visible: torch.Tensor) -> torch.Tensor:
    """Shares (B, 3, ceil(H / 4), ceil(W / 4)) of `MASK_CLASSES` in each cell, from masks (B, H, W) bool.

    Cell i is centred on pixel 4 i, as the features of the network's first convolution are.
    """
    return cell_shares(torch.stack([visible, amodal & ~visible, ~amodal], dim=1).float())


def cell_shares(images: torch.Tensor) -> torch.Tensor:
    """Means (B, C, ceil(H / 4), ceil(W / 4)) of images (B, C, H, W) over the mask head's cells."""
    height, width = images.shape[2:]
    pad = (2, -(width + 2) % MASK_STRIDE, 2, -(height + 2) % MASK_STRIDE)
    return functional.avg_pool2d(functional.pad(images, pad, mode="replicate"), MASK_STRIDE)
