"""Layers that the parts of the recognition network share."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Any

import torch
from torch import nn

from vig.parallel.internals import packed_convolution

MOST_SIZES = 6
"""Sizes of inputs for which a network's weights are laid out, 4 MB each: a window's, and those of a folder's
photos at two scales, upright and wide."""


def convolution(inputs: int, outputs: int, kernel: int, stride: int = 1, groups: int = 1) -> nn.Module:
    """A convolution with normalisation and ReLU6."""
    return nn.Sequential(
        nn.Conv2d(inputs, outputs, kernel, stride, padding=kernel // 2, groups=groups, bias=False),
        nn.BatchNorm2d(outputs, 1e-3),
        nn.ReLU6(inplace=True),
    )


class PackedConvolution(nn.Module):
    """A convolution of a network that only predicts on the CPU, with the ReLU6 after it, in one call.

    Its weights are laid out for inputs of a size when that comes again: windows have one, photos many.
    """

    def __init__(self, layers: nn.Sequential):
        super().__init__()
        self.layers = layers
        self.runs: dict[torch.Size, Callable[[torch.Tensor], torch.Tensor]] = {}
        self.latest: deque[torch.Size] = deque(maxlen=4)  # of those that it is not laid out for

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        size = x.shape[2:]
        if size not in self.runs:
            if size not in self.latest or len(self.runs) == MOST_SIZES:
                self.latest.append(size)
                return self.layers(x)  # type: ignore[no-any-return]
            packed = packed_convolution(self.layers[0], len(self.layers) > 1, x.shape)  # type: ignore[arg-type]
            self.runs[size] = packed or self.layers.forward
        return self.runs[size](x)

    def __getstate__(self) -> dict[str, Any]:
        """Without what is laid out, which is not to be copied: weights of a copy may change."""
        return {**vars(self), "runs": {}}


def pack_convolutions(network: nn.Module) -> None:
    """Prepare convolutions without normalisation, with ReLU6 or alone, for prediction on the CPU."""
    for parent in list(network.modules()):
        for name, layers in parent.named_children():
            kinds = [type(each) for each in layers] if type(layers) is nn.Sequential else []
            if kinds in ([nn.Conv2d], [nn.Conv2d, nn.ReLU6]):
                setattr(parent, name, PackedConvolution(layers))  # type: ignore[arg-type]


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
    """As many linear layers as groups, side by side: each sees its share of the inputs alone."""

    def __init__(self, inputs: int, outputs: int, groups: int):
        super().__init__(inputs // groups, outputs)
        self.groups = groups

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        if self.groups == 1:
            return super().forward(x)
        weight = self.weight.unflatten(0, (self.groups, -1))
        return torch.einsum("bgi,goi->bgo", x.unflatten(1, (self.groups, -1)), weight).flatten(1) + self.bias
