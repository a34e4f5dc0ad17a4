"""Augmentation of a batch, so that a network trained on rasterised images holds on photographs.

Flips, framing, things pasted in front, uneven light, and a camera: exposure, white balance, blur, noise.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch.nn import functional

from vig_lab.training.examples import Examples
from vig_lab.training.targets import cell_shares, mirrored

GAMMA = 2.2
"""sRGB is nearly linear light to the power of one over this."""

NO_MASK = -1.0
"""Mask shares of an image whose mask is unknown."""


@dataclass(frozen=True)
class Augmentation:
    """How much is changed.

    Attributes:
        flip: Share of batches that are mirrored.
        reframe: Share of batches that are shifted and magnified, as boxes drawn by hand are.
        cut_out: Share of images that have a piece of another pasted over.
        relight: Standard deviation of the log of a smooth field of light.
        exposure: Standard deviation in stops.
        balance: Standard deviation of log white balance.
        blur: Share of batches that are blurred.
        most_blur: By up to how many pixels.
        noise: Largest standard deviation of noise, sRGB.
    """

    flip: float = 0.5
    reframe: float = 0.3
    cut_out: float = 0.25
    relight: float = 0.1
    exposure: float = 0.1
    balance: float = 0.02
    blur: float = 0.4
    most_blur: float = 0.9
    noise: float = 0.03

    def __call__(
        self, batch: Examples, rng: np.random.Generator
    ) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor, torch.Tensor]:
        """Images (B, 3, H, W) sRGB in [0, 1], azimuths (B,), numbers (B, M), mask shares (B, 3, h, w)."""
        images = batch.images.permute(0, 3, 1, 2).float().div(255)
        azimuth, numbers, mask = batch.azimuth, batch.numbers, batch.mask.float() / 255
        if rng.random() < self.flip:
            azimuth, numbers = mirrored(azimuth, numbers)
            images, mask = images.flip(3), mask.flip(3)
        images, mask = self._paste(images, mask, rng)
        images = self._photograph(images, rng)
        if rng.random() < self.reframe:
            images, mask = _reframed(images, rng), torch.full_like(mask, NO_MASK)
        return images.contiguous(memory_format=torch.channels_last), azimuth, numbers, mask

    def _paste(
        self, images: torch.Tensor, mask: torch.Tensor, rng: np.random.Generator
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """Paste pieces of the batch's images over others: what they cover of the object is hidden."""
        count, _, height, width = images.shape
        on = rng.random(count) < self.cut_out
        if not on.any() or count < 2:
            return images, mask
        chosen = np.flatnonzero(on)
        pieces = torch.from_numpy(blobs(len(chosen), height, width, rng))
        pieces = pieces.to(images.device, images.dtype)[:, None]
        other = torch.from_numpy((chosen + rng.integers(1, count, len(chosen))) % count).to(images.device)
        at = torch.from_numpy(chosen).to(images.device)
        images, mask = images.clone(), mask.clone()
        images[at] = torch.lerp(images[at], images[other].roll(int(rng.integers(width)), 3), pieces)
        covered = cell_shares(pieces)
        taken = mask[at, 0] * covered[:, 0]
        mask[at, 0] -= taken
        mask[at, 1] += taken
        return images, mask

    def _photograph(self, images: torch.Tensor, rng: np.random.Generator) -> torch.Tensor:
        """Uneven light, exposure and white balance, then blur and noise."""
        count, _, height, width = images.shape
        gain = rng.normal(0, self.exposure * np.log(2), (count, 1)) + rng.normal(0, self.balance, (count, 3))
        field = torch.from_numpy(rng.normal(0, self.relight, (count, 1, 4, 4))).to(images)
        field = field + torch.from_numpy(gain[:, :, None, None]).to(images)
        light = functional.interpolate((field / GAMMA).exp(), (height, width), mode="bilinear")
        images = images * light
        if rng.random() < self.blur:
            images = _blurred(images, float(rng.uniform(0.2, self.most_blur)))
        noise = torch.randn_like(images) * float(rng.uniform(0, self.noise))
        return (images + noise).clamp(0, 1)


def blobs(count: int, height: int, width: int, rng: np.random.Generator) -> np.ndarray:
    """Random convex pieces (count, H, W) float32 in {0, 1}: ellipses and boxes, turned."""
    centre = rng.uniform(0.1, 0.9, (count, 2)) * [width, height]
    reach = np.exp(rng.uniform(np.log(0.05), np.log(0.3), (count, 2))) * width
    angle, power = rng.uniform(0, np.pi, count), rng.choice([2.0, 8.0], count)
    x = np.arange(width)[None, None] + 0.5 - centre[:, 0, None, None]
    y = np.arange(height)[None, :, None] + 0.5 - centre[:, 1, None, None]
    cos, sin = np.cos(angle)[:, None, None], np.sin(angle)[:, None, None]
    along, across = np.abs(cos * x + sin * y), np.abs(cos * y - sin * x)
    power = power[:, None, None]
    inside: np.ndarray = (along / reach[:, 0, None, None]) ** power + (
        across / reach[:, 1, None, None]
    ) ** power < 1
    return inside.astype(np.float32)


def _reframed(images: torch.Tensor, rng: np.random.Generator) -> torch.Tensor:
    """Shift and magnify each image a little, as a box drawn by hand does."""
    count = len(images)
    matrix = np.zeros((count, 2, 3), np.float32)
    matrix[:, 0, 0] = matrix[:, 1, 1] = np.exp(rng.normal(0, 0.05, count))
    matrix[:, :, 2] = rng.normal(0, 0.05, (count, 2))
    moved = torch.from_numpy(matrix).to(images.device)
    grid = functional.affine_grid(moved, list(images.shape), align_corners=False)
    return functional.grid_sample(images, grid, padding_mode="border", align_corners=False)


def _blurred(images: torch.Tensor, deviation: float) -> torch.Tensor:
    """Gaussian blur by `deviation` pixels of images (B, 3, H, W)."""
    offsets = torch.arange(-2, 3, device=images.device, dtype=images.dtype)
    kernel = torch.softmax(-0.5 * (offsets / deviation) ** 2, 0)
    padded = functional.pad(images, (2, 2, 2, 2), mode="replicate")
    height, width = images.shape[2:]
    rows = sum((kernel[i] * padded[:, :, i : i + height] for i in range(5)), torch.zeros(1))
    return sum((kernel[i] * rows[:, :, :, i : i + width] for i in range(5)), torch.zeros(1))
