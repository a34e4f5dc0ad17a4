"""The recognition network: its outputs, their calibration, and its layers."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import torch
from torch import nn
from torch.nn import functional
from torch.nn.utils.fusion import fuse_conv_bn_eval

from vig.io.checks import check_number
from vig.parallel.internals import has_bfloat16
from vig.recognition.decoder import ATTENTION_HEADS, CELLS, ContextDecoder
from vig.recognition.layers import GroupedLinear, InvertedResidual, convolution, pack_convolutions
from vig.recognition.object_map import ObjectMap
from vig.scene import LatentLayout, Latents, regressed_layout, rotate_z
from vig.scene.shape_model import MOST_MODES

MASK_STRIDE = 2
"""Pixels a side of the mask head's cells."""


def layout_of_numbers(count: int) -> LatentLayout:
    """The layout of M regressed numbers; their K follows from it."""
    return regressed_layout(count - regressed_layout(0).size)


def latents_of(numbers: torch.Tensor, azimuth: torch.Tensor) -> Latents:
    """Latents of regressed numbers (B, M) and azimuths (B,) radians, clipped to the bounds."""
    layout = layout_of_numbers(numbers.shape[1])
    lower, upper = (numbers.new_tensor(bound) for bound in layout.bounds())
    parts = layout.split(numbers.clamp(lower, upper))
    return Latents(
        parts["shape"], azimuth, parts["elevation"][:, 0], parts["albedo"], rotate_z(parts["light"], azimuth)
    )


_MIRRORED_LIGHT = (3, 4, 7)
"""Heading-frame coefficients odd in x: (1,1), (2,-2), (2,1)."""


def mirrored(azimuth: torch.Tensor, numbers: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Azimuths (B,) and numbers (B, M) of photos flipped left to right, of a class that is its own mirror
    image in y = 0.
    """
    flipped = numbers.clone()
    light = layout_of_numbers(numbers.shape[1]).at("light")
    flipped[:, [light + coefficient for coefficient in _MIRRORED_LIGHT]] *= -1
    return torch.remainder(math.pi - azimuth, 2 * math.pi), flipped


def mask_at_pixels(logits: torch.Tensor, height: int, width: int) -> torch.Tensor:
    """Probabilities (B, H, W, 3) of `MASK_CLASSES` from the mask head's (B, 3, h, w) logits."""
    full = functional.interpolate(logits, scale_factor=MASK_STRIDE, mode="bilinear", align_corners=False)
    return full[:, :, :height, :width].softmax(1).permute(0, 2, 3, 1)


MASK_CLASSES = ("visible", "hidden", "background")
"""What a pixel shows: the object; something before it; neither (the object is not there)."""


STRIDES = (1, 2, 2, 2, 1)
"""Of the first convolution of each of the trunk's stages."""
KERNELS = (3, 3, 5, 3, 5)
"""Sides of the stages' depthwise kernels, pixels."""


@dataclass(frozen=True)
class NetworkSettings:
    """Sizes of the network; written beside the weights so that they can be read again.

    The trunk is that of EfficientNet-Lite0 (Tan and Le 2019) up to its eleventh block.

    Attributes:
        modes: K shape components.
        azimuth_bins: Equal bins of the circle.
        channels: Of the first convolution, then of each of the trunk's five stages.
        blocks: Inverted residual blocks of each stage.
        expansion: Channels within a block over those between blocks; the first stage has no expansion.
        decoder: Channels of the mask's decoder.
        context: Channels, from coarse to fine, of a decoder that sees the whole image, in its place; or
            none.
        recalled: Channels that the dense layer adds to the decoder's coarsest map, so that what is hidden
            can be drawn from what the whole looks like.
        squeezed: Channels from which the dense layer reads.
        features: Of the dense layer.
        dropout: Share of these features.
        object_map: Channels of the map of objects of a whole photo, or none.
        members: Dense layers side by side, each with as many of the squeezed channels and of the features:
            an ensemble whose logits and numbers the heads average.
    """

    modes: int = 10
    azimuth_bins: int = 72
    channels: tuple[int, ...] = (32, 16, 24, 40, 80, 112)
    blocks: tuple[int, ...] = (1, 2, 2, 3, 3)
    expansion: int = 6
    decoder: int = 64
    context: tuple[int, ...] = ()
    object_map: int = 0
    recalled: int = 16
    squeezed: int = 48
    features: int = 384
    dropout: float = 0.1
    members: int = 1

    def __post_init__(self) -> None:
        if (len(self.channels), len(self.blocks)) != (6, 5):
            raise ValueError(f"channels and blocks must be 6 and 5; got {self.channels} and {self.blocks}")
        check_sizes("channels", self.channels, 1, 2048)
        check_sizes("blocks", self.blocks, 1, 64)
        if len(self.context) not in (0, 4) or (self.context and self.context[0] % ATTENTION_HEADS):
            raise ValueError(f"context must be four numbers of channels, or none; got {self.context}")
        check_sizes("context", self.context, 1, 2048)
        check_sizes("object_map", (self.object_map,), 0, 2048)
        check_sizes("expansion", (self.expansion,), 1, 16)
        check_sizes("modes", (self.modes,), 1, MOST_MODES)
        check_sizes("azimuth_bins", (self.azimuth_bins,), 6, 3600)
        if self.azimuth_bins % 2:
            raise ValueError(
                f"azimuth_bins must be even, so that a mirrored bin is one; got {self.azimuth_bins}"
            )
        widths = (self.decoder, self.recalled, self.squeezed, self.features)
        check_sizes("decoder, recalled, squeezed, features", widths, 1, 8192)
        check_sizes("members", (self.members,), 1, 64)
        if self.squeezed % self.members or self.features % self.members:
            raise ValueError(f"squeezed and features must be multiples of members; got {self}")
        check_number("dropout", self.dropout, 0.0, 0.99)


@dataclass(frozen=True)
class Heads:
    """Network outputs for B images.

    Attributes:
        azimuth: (B, bins) logits of equal bins, the first centred at half a bin.
        mean: (B, M) regressed numbers (see `regressed_layout`), in units of the targets' standard deviations.
        log_variance: (B, M) of these.
        roll: (B,) clockwise turn of the image, radians.
        presence: (B,) logit that the image shows the object.
        mask: (B, 3, h, w) logits of MASK_CLASSES, a cell for each `MASK_STRIDE` pixels.
    """

    azimuth: torch.Tensor
    mean: torch.Tensor
    log_variance: torch.Tensor
    roll: torch.Tensor
    presence: torch.Tensor
    mask: torch.Tensor

    def of_mirrored(self, centre: torch.Tensor) -> Heads:
        """What these, of flipped photos, say of the photos themselves.

        centre: (M,) the numbers 0 in units of the heads, about which those of the light change sign.
        """
        bins = self.azimuth.shape[1]
        _, offset = mirrored(self.roll, self.mean - centre)
        return Heads(
            self.azimuth.flip(1).roll(bins // 2, 1),
            offset + centre,
            self.log_variance,
            -self.roll,
            self.presence,
            self.mask.flip(3),
        )

    def mean_with(self, other: Heads) -> Heads:
        """The mean of two that speak of the same photos."""
        pairs = zip(vars(self).values(), vars(other).values(), strict=True)
        return Heads(*((mine + others) / 2 for mine, others in pairs))


@dataclass(frozen=True)
class NetworkCalibration:
    """Corrections of a network's stated uncertainties.

    Attributes:
        azimuth_temperature: () by which logits are divided (Guo et al. 2017).
        mask_temperature: () likewise.
        deviation: (M,) factors of the stated standard deviations.
    """

    azimuth_temperature: torch.Tensor
    mask_temperature: torch.Tensor
    deviation: torch.Tensor

    PREFIX: ClassVar[str] = "calibration."
    """Of its tensors' names in a weights file."""

    @classmethod
    def of(cls, tensors: Mapping[str, torch.Tensor], numbers: int) -> NetworkCalibration:
        """From the tensors of a weights file; without effect when it has none.

        Raises:
            ValueError: They do not fit a network of `numbers` regressed numbers.
        """
        own = {k.removeprefix(cls.PREFIX): v for k, v in tensors.items() if k.startswith(cls.PREFIX)}
        if not own:
            return cls(torch.ones(()), torch.ones(()), torch.ones(numbers))
        shapes = {"azimuth_temperature": (), "mask_temperature": (), "deviation": (numbers,)}
        if {name: tuple(value.shape) for name, value in own.items()} != shapes:
            raise ValueError("the calibration does not fit the network")
        for value in own.values():
            if not value.is_floating_point() or not ((value > 1e-3) & (value < 1e3)).all():
                raise ValueError("the calibration's factors must be from 0.001 to 1000")
        return cls(**own)

    def tensors(self) -> dict[str, torch.Tensor]:
        """As they go into a weights file."""
        return {self.PREFIX + name: value for name, value in vars(self).items()}


def check_sizes(name: str, sizes: tuple[int, ...], low: int, high: int) -> None:
    """ValueError unless all sizes of a network lie in [low, high]."""
    if not all(low <= size <= high for size in sizes):
        raise ValueError(f"{name} must be from {low} to {high}; got {sizes}")


def fold_normalisation(network: nn.Module) -> None:
    """Make batch normalisation part of the convolution before it: a network that only predicts is faster."""
    for layers in list(network.modules()):
        pair = list(layers.children())[:2]
        if isinstance(layers, nn.Sequential) and [type(x) for x in pair] == [nn.Conv2d, nn.BatchNorm2d]:
            layers[0] = fuse_conv_bn_eval(*pair)  # type: ignore[type-var,arg-type]
            del layers[1]


def prepare_for_bfloat16(network: nn.Module) -> None:
    """Store weights of convolutions and dense layers in bfloat16, laid out for it, where `bfloat16` uses it.

    Autocast would convert them at each call. A network in float32 stays as it is: with packed convolutions
    its last bits would depend on which calls came before.
    """
    if has_bfloat16():
        # Attention multiplies its weights as they are stored.
        within = {
            id(part)
            for layer in network.modules()
            if isinstance(layer, nn.TransformerEncoderLayer)
            for part in layer.modules()
        }
        for layer in network.modules():
            if isinstance(layer, nn.Conv2d | nn.Linear) and id(layer) not in within:
                layer.weight.data = layer.weight.data.to(torch.bfloat16)
        pack_convolutions(network)


class RecognitionNetwork(nn.Module):
    """From an image (B, 3, 150, 150), sRGB in [0, 1], to `Heads`."""

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
        merged = self._decoded(features, maps)
        mean, log_variance = self.numbers(features).float().chunk(2, dim=1)
        roll, presence = self.others(features).float().unbind(1)
        return Heads(
            self.azimuth(features).float(),
            mean,
            log_variance.clamp(-8.0, 4.0),
            roll,
            presence,
            self.mask(merged).float(),
        )

    def maps(self, image: torch.Tensor) -> list[torch.Tensor]:
        """Of the trunk's stages, for images (B, 3, H, W) of any size, sRGB in [0, 1]."""
        x, maps = self.stem(image * 2 - 1), []
        for stage in self.stages:
            x = stage(x)
            maps.append(x)
        return maps

    def coarse_maps(self, image: torch.Tensor) -> torch.Tensor:
        """Of the last two stages, joined, from which the map of objects is read."""
        return torch.cat(self.maps(image)[-2:], 1)

    def _decoded(self, features: torch.Tensor, maps: list[torch.Tensor]) -> torch.Tensor:
        """Features of the mask head's cells."""
        half, quarter, eighth, sixteenth, coarse = maps
        if self.settings.context:
            decoded: torch.Tensor = self.context((coarse, sixteenth), (eighth, quarter, half))
            return decoded
        recalled = self.recalled(features).unflatten(1, (-1, self.COARSE_CELLS, self.COARSE_CELLS))
        merged: torch.Tensor = self.deep(torch.cat([coarse, recalled], 1))
        for finer, side, merge in zip((eighth, quarter, half), self.side, self.merge, strict=True):
            height, width = finer.shape[-2:]
            upsampled = functional.interpolate(merged, scale_factor=2.0)[..., :height, :width]
            merged = merge(upsampled + side(finer))
        return merged


def bfloat16(device: torch.device) -> torch.autocast:
    """Arithmetic in bfloat16 where the processor has it (AVX-512 BF16, AMX, CUDA), else as it is."""
    if device.type == "cuda":
        return torch.autocast("cuda", torch.bfloat16, enabled=torch.cuda.is_bf16_supported())
    return torch.autocast("cpu", torch.bfloat16, enabled=has_bfloat16())
