"""The recognition network: one convolutional trunk, a head for each group of latents, and a mask head."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import nn
from torch.nn import functional

from vig.scene.light import L_COUNT

MASK_CLASSES = ("visible", "hidden", "background")
"""What a pixel shows: the object; something before it; neither (the object is not there)."""


@dataclass(frozen=True)
class NetworkSettings:
    """Widths of the network; written into a class pack so that weights can be read again."""

    modes: int = 10
    azimuth_bins: int = 72
    widths: tuple[int, int, int, int] = (16, 32, 64, 128)
    features: int = 256
    dropout: float = 0.2


@dataclass(frozen=True)
class Heads:
    """What the network says of B images.

    azimuth (B, bins): logits over equal bins, the first centred at half a bin. mean, log_variance (B, N),
    N = 1 + K + 3 + 9: elevation, shape, albedo and light in the heading frame (see `targets`), in units of
    the targets' standard deviations. mask (B, 3, h, w): logits of MASK_CLASSES at a quarter of the size.
    """

    azimuth: torch.Tensor
    mean: torch.Tensor
    log_variance: torch.Tensor
    mask: torch.Tensor


class RecognitionNetwork(nn.Module):
    """From an image (B, 3, S, S), sRGB in [0, 1], to `Heads`."""

    def __init__(self, settings: NetworkSettings):
        super().__init__()
        self.settings = settings
        a, b, c, d = settings.widths
        self.stem = nn.Sequential(_convolution(3, a, 5, 2), _convolution(a, b, 3, 2))
        self.fine = _Residual(b)
        self.middle = nn.Sequential(_convolution(b, c, 3, 2), _Residual(c), _Residual(c))
        self.coarse = nn.Sequential(_convolution(c, d, 3, 2), _Residual(d), _Residual(d))
        self.dense = nn.Sequential(
            nn.Flatten(), nn.Linear(d * 25, settings.features), nn.ReLU(), nn.Dropout(settings.dropout)
        )
        self.azimuth = nn.Linear(settings.features, settings.azimuth_bins)
        self.numbers = nn.Linear(settings.features, 2 * (1 + settings.modes + 3 + L_COUNT))
        self.mask_coarse = _convolution(d, b, 1, 1)
        self.mask_middle = _convolution(c, b, 1, 1)
        self.mask = nn.Sequential(_convolution(b, b, 3, 1), nn.Conv2d(b, len(MASK_CLASSES), 1))

    def forward(self, image: torch.Tensor) -> Heads:
        fine = self.fine(self.stem(image * 4 - 2))
        middle = self.middle(fine)
        coarse = self.coarse(middle)
        features = self.dense(functional.adaptive_avg_pool2d(coarse, 5))
        mean, log_variance = self.numbers(features).float().chunk(2, dim=1)
        size = middle.shape[-2:]
        merged = self.mask_middle(middle) + functional.interpolate(self.mask_coarse(coarse), size)
        merged = functional.interpolate(merged, fine.shape[-2:]) + fine
        return Heads(
            self.azimuth(features).float(), mean, log_variance.clamp(-8.0, 4.0), self.mask(merged).float()
        )


class _Residual(nn.Module):
    def __init__(self, width: int):
        super().__init__()
        self.first = _convolution(width, width, 3, 1)
        self.second = nn.Sequential(nn.Conv2d(width, width, 3, padding=1, bias=False), nn.BatchNorm2d(width))

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        return functional.relu(x + self.second(self.first(x)))


def _convolution(inputs: int, outputs: int, kernel: int, stride: int) -> nn.Module:
    return nn.Sequential(
        nn.Conv2d(inputs, outputs, kernel, stride, padding=kernel // 2, bias=False),
        nn.BatchNorm2d(outputs),
        nn.ReLU(),
    )
