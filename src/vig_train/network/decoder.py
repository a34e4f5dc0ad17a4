"""Parts that read a trunk's maps: a decoder of masks that sees the whole image, the map of objects."""

from collections.abc import Sequence

import torch
from torch import nn
from torch.nn import functional

from vig.recognition.network import ATTENTION_HEADS, ATTENTION_LAYERS, CELLS
from vig.recognition.object_map import NUMBERS


def convolution(inputs: int, outputs: int, kernel: int, stride: int = 1, groups: int = 1) -> nn.Module:
    """Return a convolution with normalisation and ReLU6."""
    return nn.Sequential(
        nn.Conv2d(inputs, outputs, kernel, stride, padding=kernel // 2, groups=groups, bias=False),
        nn.BatchNorm2d(outputs, 1e-3),
        nn.ReLU6(inplace=True),
    )


class ContextDecoder(nn.Module):
    """Computes, from a trunk's maps, features of each cell at half the image's size.

    A dense layer remembers from the coarsest map the look of such objects; self-attention over all of its
    cells, then residual convolutions from coarse to fine.
    """

    def __init__(
        self,
        coarse: Sequence[int],
        finer: Sequence[int],
        widths: Sequence[int],
        squeezed: int,
        features: int,
        recalled: int,
    ):
        """Make a decoder of these channels.

        Args:
            coarse: Channels of the coarsest map, `CELLS` a side, and of another as large.
            finer: Channels of the finer maps, each of twice the size.
            widths: Widths of the decoder, at the coarsest map and at each of the finer ones.
            squeezed: Channels that the dense layer reads.
            features: Outputs of the dense layer.
            recalled: Channels that it adds to the coarsest map.
        """
        super().__init__()
        self.recall = nn.Sequential(
            convolution(coarse[0], squeezed, 1),
            nn.Flatten(),
            nn.Linear(squeezed * CELLS**2, features),
            nn.ReLU(),
            nn.Linear(features, recalled * CELLS**2),
            nn.Unflatten(1, (recalled, CELLS, CELLS)),
        )
        self.enter = convolution(sum(coarse) + recalled, widths[0], 1)
        self.place = nn.Parameter(torch.empty(1, CELLS**2, widths[0]))
        # Normal numbers on the meta device would load torch's compiler, which takes a second.
        nn.init.uniform_(self.place, -0.035, 0.035)
        self.attention = nn.ModuleList(
            nn.TransformerEncoderLayer(
                widths[0], ATTENTION_HEADS, 2 * widths[0], 0.0, batch_first=True, norm_first=True
            )
            for _ in range(ATTENTION_LAYERS)
        )
        self.mix = _Residual(widths[0])
        self.down = nn.ModuleList(convolution(*pair, 1) for pair in zip(widths, widths[1:], strict=False))
        self.side = nn.ModuleList(convolution(*pair, 1) for pair in zip(finer, widths[1:], strict=True))
        self.merge = nn.ModuleList(_Residual(width) for width in widths[1:])

    def forward(self, coarse: Sequence[torch.Tensor], finer: Sequence[torch.Tensor]) -> torch.Tensor:
        """Return features (B, C, h, w) as large as the last of the finer maps."""
        merged: torch.Tensor = self.enter(torch.cat([*coarse, self.recall(coarse[0])], 1))
        cells = merged.flatten(2).mT + self.place
        with torch.autocast(cells.device.type, enabled=False):  # torch 2.5 mixes its types in such layers
            cells = cells.float()
            for layer in self.attention:
                cells = layer(cells)
        merged = self.mix(cells.mT.unflatten(2, merged.shape[2:]))
        for seen, down, side, merge in zip(finer, self.down, self.side, self.merge, strict=True):
            height, width = seen.shape[-2:]
            upsampled = functional.interpolate(down(merged), scale_factor=2.0, mode="bilinear")
            merged = merge(upsampled[..., :height, :width] + side(seen))
        return merged


class _Residual(nn.Module):
    """Two convolutions beside the identity."""

    def __init__(self, width: int):
        super().__init__()
        self.first = convolution(width, width, 3)
        self.second = nn.Sequential(
            nn.Conv2d(width, width, 3, padding=1, bias=False), nn.BatchNorm2d(width, 1e-3)
        )

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        change: torch.Tensor = self.second(self.first(x))
        return torch.relu(x + change)


class ObjectMap(nn.Module):
    """Computes, from two of the trunk's maps (B, C, h, w), joined, `NUMBERS` of each cell (B, 5, h, w)."""

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
