"""The recognition network in torch: it is trained here, and its graph is written from here."""

from dataclasses import dataclass

import torch
from torch import nn
from torch.nn import functional

from vig.recognition.network import KERNELS, LOG_VARIANCE, MASK_CLASSES, STRIDES, NetworkSettings
from vig.scene import regressed_layout
from vig_train.network.decoder import CELLS, ContextDecoder, ObjectMap, convolution


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


@dataclass(frozen=True)
class DenseHeads:
    """Network outputs for B images, as `vig.recognition.network.Heads`, but for the mask."""

    azimuth: torch.Tensor
    mean: torch.Tensor
    log_variance: torch.Tensor
    roll: torch.Tensor
    presence: torch.Tensor


@dataclass(frozen=True)
class Heads(DenseHeads):
    """Network outputs for B images, as `vig.recognition.network.Heads`."""

    mask: torch.Tensor


class RecognitionNetwork(nn.Module):
    """Maps images (B, 3, 150, 150), sRGB in [0, 1], to `Heads`."""

    COARSE_CELLS = CELLS

    def __init__(self, settings: NetworkSettings):
        super().__init__()
        self.settings = settings
        first, *outputs = settings.channels
        self.stem = convolution(3, first, 3, stride=2)
        inputs, stages = first, []
        for number, (width, count) in enumerate(zip(outputs, settings.blocks, strict=True)):
            expansion = settings.expansion if number else 1
            blocks = [InvertedResidual(inputs, width, expansion, KERNELS[number], STRIDES[number])]
            blocks += [
                InvertedResidual(width, width, expansion, KERNELS[number], 1) for _ in range(count - 1)
            ]
            stages.append(nn.Sequential(*blocks))
            inputs = width
        self.stages = nn.ModuleList(stages)
        self.dense = nn.Sequential(
            convolution(inputs, settings.squeezed, 1),
            nn.Flatten(),
            GroupedLinear(settings.squeezed * self.COARSE_CELLS**2, settings.features, settings.members),
            nn.ReLU(),
            nn.Dropout(settings.dropout),
        )
        self.azimuth = nn.Linear(settings.features, settings.azimuth_bins)
        self.numbers = nn.Linear(settings.features, 2 * regressed_layout(settings.modes).size)
        self.others = nn.Linear(settings.features, 2)
        half, quarter, eighth, sixteenth, coarse = outputs
        if settings.object_map:
            self.object_map = ObjectMap(sixteenth + coarse, settings.object_map)
        wide, narrow = settings.decoder, settings.decoder // 2
        if settings.context:
            widths = settings.squeezed, settings.features, settings.recalled
            maps = (coarse, sixteenth), (eighth, quarter, half)
            self.context = ContextDecoder(*maps, settings.context, *widths)
            self.mask = nn.Conv2d(settings.context[-1], len(MASK_CLASSES), 1)
            return
        self.recalled = nn.Linear(settings.features, settings.recalled * self.COARSE_CELLS**2)
        self.deep = nn.Sequential(
            convolution(coarse + settings.recalled, wide, 1), convolution(wide, wide, 3)
        )
        self.side = nn.ModuleList(
            convolution(*sizes, 1) for sizes in ((eighth, wide), (quarter, wide), (half, narrow))
        )
        self.merge = nn.ModuleList(
            convolution(*sizes, 3) for sizes in ((wide, wide), (wide, narrow), (narrow, narrow))
        )
        self.mask = nn.Conv2d(narrow, len(MASK_CLASSES), 1)

    def forward(self, image: torch.Tensor) -> Heads:
        maps = self.maps(image)
        features = self.dense(maps[-1])
        merged = self._decode(features, maps)
        mean, log_variance = self.numbers(features).float().chunk(2, dim=1)
        roll, presence = self.others(features).float().unbind(1)
        return Heads(
            self.azimuth(features).float(),
            mean,
            log_variance.clamp(*LOG_VARIANCE),
            roll,
            presence,
            self.mask(merged).float(),
        )

    def maps(self, image: torch.Tensor) -> list[torch.Tensor]:
        """Return the maps of the trunk's stages, for images (B, 3, H, W) of any size, sRGB in [0, 1]."""
        x, maps = self.stem(image * 2 - 1), []
        for stage in self.stages:
            x = stage(x)
            maps.append(x)
        return maps

    def coarse_maps(self, image: torch.Tensor) -> torch.Tensor:
        """Return the maps of the last two stages, joined, from which the map of objects is read."""
        return torch.cat(self.maps(image)[-2:], 1)

    def _decode(self, features: torch.Tensor, maps: list[torch.Tensor]) -> torch.Tensor:
        """Return features of the mask head's cells."""
        half, quarter, eighth, sixteenth, coarse = maps
        if self.settings.context:
            return self.context((coarse, sixteenth), (eighth, quarter, half))
        recalled = self.recalled(features).unflatten(1, (-1, self.COARSE_CELLS, self.COARSE_CELLS))
        merged: torch.Tensor = self.deep(torch.cat([coarse, recalled], 1))
        for finer, side, merge in zip((eighth, quarter, half), self.side, self.merge, strict=True):
            height, width = finer.shape[-2:]
            upsampled = functional.interpolate(merged, scale_factor=2.0)[..., :height, :width]
            merged = merge(upsampled + side(finer))
        return merged


def has_bfloat16() -> bool:
    """Return whether the processor multiplies in bfloat16 (AVX-512 BF16, AMX); False when unknown."""
    ask = getattr(torch.cpu, "_is_avx512_bf16_supported", None)
    return bool(ask()) if ask is not None else False


def bfloat16(device: torch.device) -> torch.autocast:
    """Compute in bfloat16 where the processor has it (AVX-512 BF16, AMX, CUDA), else as it is."""
    if device.type == "cuda":
        return torch.autocast("cuda", torch.bfloat16, enabled=torch.cuda.is_bf16_supported())
    return torch.autocast("cpu", torch.bfloat16, enabled=has_bfloat16())
