"""Description of a recognition network: its sizes, its outputs, and their calibration."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from vig.io.checks import check_number
from vig.scene import LatentLayout, Latents, regressed_layout, rotate_z
from vig.scene.shape_model import MAX_MODES
from vig_renderer.arrays import Array, like

MASK_CLASSES = ("visible", "hidden", "background")
"""Classes of a pixel: the object; something before it; neither (the object is not there)."""
MASK_STRIDE = 2
"""Pixels a side of the mask head's cells."""
ATTENTION_HEADS = 4
"""Heads of self-attention in a decoder that sees the whole image."""
ATTENTION_LAYERS = 2
"""Layers of it, over the cells of the coarsest map."""
CELLS = 10
"""Side of the coarsest map of a window: the image's at a sixteenth of its size."""
LOG_VARIANCE = -8.0, 4.0
"""Least and greatest that the network states."""


def layout_of_numbers(count: int) -> LatentLayout:
    """Return the layout of M regressed numbers; their K follows from it."""
    return regressed_layout(count - regressed_layout(0).size)


def latents_of(numbers: Array, azimuth: Array) -> Latents:
    """Return the latents of regressed numbers (B, M) and azimuths (B,) radians, clipped to the bounds."""
    layout = layout_of_numbers(numbers.shape[1])
    lower, upper = (like(numbers, bound) for bound in layout.bounds())
    parts = layout.split(numbers.clip(lower, upper))
    return Latents(
        parts["shape"], azimuth, parts["elevation"][:, 0], parts["albedo"], rotate_z(parts["light"], azimuth)
    )


_MIRRORED_LIGHT = (3, 4, 7)
"""Heading-frame coefficients odd in x: (1,1), (2,-2), (2,1)."""


def mirror_prediction(azimuth: np.ndarray, numbers: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return azimuths (B,) and numbers (B, M) of mirrored photos of a class symmetric about y = 0."""
    flipped = numbers.copy()
    light = layout_of_numbers(numbers.shape[1]).at("light")
    flipped[:, [light + coefficient for coefficient in _MIRRORED_LIGHT]] *= -1
    return (math.pi - azimuth) % (2 * math.pi), flipped


def mask_at_pixels(logits: np.ndarray, height: int, width: int) -> np.ndarray:
    """Return probabilities (B, H, W, 3) of `MASK_CLASSES` from the mask head's (B, 3, h, w) logits."""
    across = _double_rows(_double_rows(logits.swapaxes(2, 3)).swapaxes(2, 3))
    full = across[:, :, :height, :width]
    full = np.exp(full - full.max(1, keepdims=True))
    full /= full.sum(1, keepdims=True)
    return np.ascontiguousarray(full.transpose(0, 2, 3, 1))


def _double_rows(rows: np.ndarray) -> np.ndarray:
    """Return twice as many rows (B, C, H, W), linear between the middles of the given ones."""
    count, channels, height, width = rows.shape
    near, far = np.float32(0.75) * rows, np.float32(0.25) * rows
    doubled = np.empty((count, channels, 2 * height, width), np.float32)
    doubled[:, :, 0::2], doubled[:, :, 1::2] = near, near
    doubled[:, :, 2::2] += far[:, :, :-1]
    doubled[:, :, 1:-1:2] += far[:, :, 1:]
    doubled[:, :, 0], doubled[:, :, -1] = rows[:, :, 0], rows[:, :, -1]
    return doubled


STRIDES = (1, 2, 2, 2, 1)
"""Strides of the first convolution of each of the trunk's stages."""
KERNELS = (3, 3, 5, 3, 5)
"""Sides of the stages' depthwise kernels, pixels."""


@dataclass(frozen=True)
class NetworkSettings:
    """Sizes of the network; written with the weights so that they can be read again.

    The trunk is that of EfficientNet-Lite0 (Tan and Le 2019) up to its eleventh block.

    Attributes:
        modes: K shape components.
        azimuth_bins: Equal bins of the circle.
        channels: Channels of the first convolution, then of each of the trunk's five stages.
        blocks: Inverted residual blocks of each stage.
        expansion: Channels within a block over those between blocks; the first stage has no expansion.
        decoder: Channels of the mask's decoder.
        context: Channels, from coarse to fine, of a decoder that sees the whole image, in its place; or
            none.
        recalled: Channels that the dense layer adds to the decoder's coarsest map, so that hidden parts
            can be drawn from the appearance of the whole.
        squeezed: Channels from which the dense layer reads.
        features: Features of the dense layer.
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
        check_sizes("modes", (self.modes,), 1, MAX_MODES)
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

    azimuth: np.ndarray
    mean: np.ndarray
    log_variance: np.ndarray
    roll: np.ndarray
    presence: np.ndarray
    mask: np.ndarray

    def of_mirrored(self, centre: np.ndarray) -> Heads:
        """Return the outputs for the photos whose flipped versions gave these.

        centre: (M,) the numbers 0 in units of the heads, about which those of the light change sign.
        """
        bins = self.azimuth.shape[1]
        _, offset = mirror_prediction(self.roll, self.mean - centre)
        return Heads(
            np.roll(self.azimuth[:, ::-1], bins // 2, 1),
            offset + centre,
            self.log_variance,
            -self.roll,
            self.presence,
            self.mask[..., ::-1],
        )

    def mean_with(self, other: Heads) -> Heads:
        """Return the mean of two outputs for the same photos."""
        pairs = zip(vars(self).values(), vars(other).values(), strict=True)
        return Heads(*((mine + others) / 2 for mine, others in pairs))


@dataclass(frozen=True)
class NetworkCalibration:
    """Corrections of a network's stated uncertainties.

    Attributes:
        azimuth_temperature: () by which logits are divided (Guo et al. 2017).
        mask_temperature: () by which logits of the mask are divided.
        deviation: (M,) factors of the stated standard deviations.
    """

    azimuth_temperature: np.ndarray
    mask_temperature: np.ndarray
    deviation: np.ndarray

    PREFIX: ClassVar[str] = "calibration."
    """Prefix of its arrays' names in a weights file."""

    @classmethod
    def of(cls, tensors: Mapping[str, np.ndarray], numbers: int) -> NetworkCalibration:
        """Read the arrays of a weights file; without effect when it has none.

        Raises:
            ValueError: They do not fit a network of `numbers` regressed numbers.
        """
        own = {k.removeprefix(cls.PREFIX): v for k, v in tensors.items() if k.startswith(cls.PREFIX)}
        if not own:
            one = np.ones((), np.float32)
            return cls(one, one, np.ones(numbers, np.float32))
        shapes = {"azimuth_temperature": (), "mask_temperature": (), "deviation": (numbers,)}
        if {name: value.shape for name, value in own.items()} != shapes:
            raise ValueError("the calibration does not fit the network")
        for value in own.values():
            if not np.issubdtype(value.dtype, np.floating) or not ((value > 1e-3) & (value < 1e3)).all():
                raise ValueError("the calibration's factors must be from 0.001 to 1000")
        return cls(**own)

    def tensors(self) -> dict[str, np.ndarray]:
        """Return the arrays of a weights file."""
        return {self.PREFIX + name: value for name, value in vars(self).items()}


def check_sizes(name: str, sizes: tuple[int, ...], low: int, high: int) -> None:
    """Raise ValueError unless all sizes of a network lie in [low, high]."""
    if not all(low <= size <= high for size in sizes):
        raise ValueError(f"{name} must be from {low} to {high}; got {sizes}")
