"""The map of objects of a whole photo, as it is trained."""

from __future__ import annotations

import torch
from torch import nn

from vig.recognition.object_map import NUMBERS
from vig_train.network.layers import convolution


class ObjectMap(nn.Module):
    """From two of the trunk's maps (B, C, h, w), joined, to `NUMBERS` of each cell (B, 5, h, w)."""

    def __init__(self, inputs: int, width: int):
        super().__init__()
        layers = [convolution(inputs, width, 1)]
        for _ in range(3):
            layers += [convolution(width, width, 3, groups=width), convolution(width, width, 1)]
        self.layers = nn.Sequential(*layers)
        self.numbers = nn.Conv2d(width, NUMBERS, 1)
        nn.init.constant_(self.numbers.bias[:1], -4.0)  # type: ignore[index]  # centres are rare

    def forward(self, maps: torch.Tensor) -> torch.Tensor:
        numbers: torch.Tensor = self.numbers(self.layers(maps))
        return numbers.float()
