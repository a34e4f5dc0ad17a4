"""Targets of the recognition network, from latents and masks."""

import math
from dataclasses import dataclass
from typing import Self

import torch
from torch.nn import functional

from vig.recognition.network import MASK_STRIDE
from vig.scene import Latents, Symmetry, regressed_layout, rotate_z


class TensorRows:
    """Base of dataclasses whose fields are tensors, or others of these, with N rows each."""

    def __getitem__(self, chosen: torch.Tensor | slice) -> Self:
        return type(self)(*(value[chosen] for value in vars(self).values()))

    def to(self, device: torch.device) -> Self:
        """Return the same on another device."""
        return type(self)(*(value.to(device) for value in vars(self).values()))


@dataclass(frozen=True)
class Targets(TensorRows):
    """Targets of the dense heads for N images.

    Attributes:
        azimuth: (N,) radians.
        numbers: (N, M), see `numbers_of`.
        roll: (N,) radians.
        present: (N,) 1 where the object is in the image, else 0.
    """

    azimuth: torch.Tensor
    numbers: torch.Tensor
    roll: torch.Tensor
    present: torch.Tensor


def azimuth_labels(
    azimuth: torch.Tensor, bins: int, spread: float = math.radians(4.0), symmetry: Symmetry = Symmetry.NONE
) -> torch.Tensor:
    """Return soft labels (B, bins) of azimuths (B,) radians: a wrapped Gaussian of `spread` radians.

    Half turns have two, half a circle apart; under any turn all bins are alike.
    """
    centres = (torch.arange(bins, device=azimuth.device) + 0.5) * (2 * math.pi / bins)
    off = symmetry.difference(azimuth[:, None], centres)
    return torch.softmax(-0.5 * (off / spread) ** 2, dim=1)


def numbers_of(latents: Latents) -> torch.Tensor:
    """Return the regressed numbers (B, M), see `regressed_layout`; light in the heading frame."""
    light = rotate_z(latents.light, -latents.azimuth)
    parts = {"shape": latents.shape, "elevation": latents.elevation[:, None], "albedo": latents.albedo}
    return regressed_layout(latents.shape.shape[1]).join(parts | {"light": light})


def cell_shares(visible: torch.Tensor, hidden: torch.Tensor) -> torch.Tensor:
    """Return shares (B, 3, ceil(H / 2), ceil(W / 2)) of `MASK_CLASSES` in each of the mask head's cells.

    visible, hidden: (B, H, W) float, shares of each pixel.
    """
    classes = torch.stack([visible, hidden, 1 - visible - hidden], dim=1).clamp(0, 1)
    return functional.avg_pool2d(classes, MASK_STRIDE, ceil_mode=True)
