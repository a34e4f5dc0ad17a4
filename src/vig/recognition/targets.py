"""The network's targets: latents in the frames in which they can be seen.

Light is predicted in the *heading frame*, the world turned about Z so that the eye is on -Y: what is bright
on the left of the photo is on the left there, whatever the object's azimuth. It is turned back with the
azimuth of each hypothesis.
"""

from __future__ import annotations

import math

import torch
from torch.nn import functional

from vig.scene import LatentLayout, Latents, angle_difference, regressed_layout, rotate_z

MASK_STRIDE = 4

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


def layout_of_numbers(count: int) -> LatentLayout:
    """The layout of M regressed numbers; their K follows from it."""
    return regressed_layout(count - regressed_layout(0).size)


def latents_of(numbers: torch.Tensor, azimuth: torch.Tensor) -> Latents:
    """The inverse of `numbers_of` for azimuths (B,) radians, clipped to what latents may be."""
    layout = layout_of_numbers(numbers.shape[1])
    lower, upper = (numbers.new_tensor(bound) for bound in layout.bounds())
    parts = layout.split(numbers.clamp(lower, upper))
    return Latents(
        parts["shape"], azimuth, parts["elevation"][:, 0], parts["albedo"], rotate_z(parts["light"], azimuth)
    )


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


def mask_at_pixels(logits: torch.Tensor, height: int, width: int) -> torch.Tensor:
    """Probabilities (B, H, W, 3) of `MASK_CLASSES` from the mask head's logits (B, 3, h, w)."""
    full = functional.interpolate(logits, scale_factor=MASK_STRIDE, mode="bilinear", align_corners=False)
    return full[:, :, 2 : 2 + height, 2 : 2 + width].softmax(1).permute(0, 2, 3, 1)
