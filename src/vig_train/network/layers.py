"""Layers that the parts of the recognition network share."""

from __future__ import annotations

import torch
from torch import nn


def convolution(inputs: int, outputs: int, kernel: int, stride: int = 1, groups: int = 1) -> nn.Module:
    """Return a convolution with normalisation and ReLU6."""
    return nn.Sequential(
        nn.Conv2d(inputs, outputs, kernel, stride, padding=kernel // 2, groups=groups, bias=False),
        nn.BatchNorm2d(outputs, 1e-3),
        nn.ReLU6(inplace=True),
    )


class InvertedResidual(nn.Module):
    """An inverted residual: channels are expanded, filtered one by one, and projected."""

    def __init__(self, inputs: int, outputs: int, expansion: int, kernel: int, stride: int):
        super().__init__()
        wide = inputs * expansion
        self.expand = convolution(inputs, wide, 1) if expansion > 1 else nn.Identity()
        self.filter = convolution(wide, wide, kernel, stride, groups=wide)
        self.project = nn.Sequential(nn.Conv2d(wide, outputs, 1, bias=False), nn.BatchNorm2d(outputs, 1e-3))
        self.residual = stride == 1 and inputs == outputs

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        projected: torch.Tensor = self.project(self.filter(self.expand(x)))
        return x + projected if self.residual else projected


class GroupedLinear(nn.Linear):
    """A linear layer for each group, side by side, which sees only its share of the inputs."""

    def __init__(self, inputs: int, outputs: int, groups: int):
        super().__init__(inputs // groups, outputs)
        self.groups = groups

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        if self.groups == 1:
            return super().forward(x)
        weight = self.weight.unflatten(0, (self.groups, -1))
        return torch.einsum("bgi,goi->bgo", x.unflatten(1, (self.groups, -1)), weight).flatten(1) + self.bias
