"""The paper's recognition networks (section 3): a small one for each factor, trained apart.

Pose and shape are read from a grey image, appearance and light from a colour one. The networks state no
uncertainty: their errors on held-out images stand for it. They have no mask.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import torch
from torch import nn

from vig.io.checks import check_number, decode
from vig.recognition.network import MASK_CLASSES, check_sizes
from vig.scene import IMAGE_SIZE, Latents, regressed_layout, rotate_z
from vig.scene.light import L_COUNT
from vig.scene.shape_model import MAX_MODES
from vig_train.network.weights import load_network
from vig_train.training.targets import azimuth_labels

FACTORS = ("pose", "shape", "appearance", "light")

_KERNEL = 5  # side of the convolutions' kernels, pixels


@dataclass(frozen=True)
class PaperSettings:
    """Sizes of each factor's network; written beside its weights so that they can be read again.

    Attributes:
        modes: K shape components.
        azimuth_bins: Equal bins of the circle, of a prediction's azimuth.
        filters: Channels of the three convolutions.
        dense: Widths of the two dense layers.
        dropout: Before each of these.
    """

    modes: int = 10
    azimuth_bins: int = 72
    filters: tuple[int, int, int] = (64, 64, 64)
    dense: tuple[int, int] = (256, 32)
    dropout: float = 0.5

    def __post_init__(self) -> None:
        check_sizes("modes", (self.modes,), 1, MAX_MODES)
        check_sizes("azimuth_bins", (self.azimuth_bins,), 5, 3600)
        check_sizes("filters, dense", (*self.filters, *self.dense), 1, 8192)
        check_number("dropout", self.dropout, 0.0, 0.99)


class FactorNetwork(nn.Module):
    """Maps images (B, 3, 150, 150), sRGB in [0, 1], to the `count` numbers of one factor (B, count).

    Attributes:
        mean_image: (1 or 3, 150, 150) mean of the training images, which is subtracted.
        centre: (count,) mean of the training targets.
        scale: () unit of the network's output about `centre`.
    """

    mean_image: torch.Tensor
    centre: torch.Tensor
    scale: torch.Tensor

    def __init__(self, count: int, grey: bool, settings: PaperSettings):
        super().__init__()
        self.grey = grey
        a, b, c = settings.filters
        first_width, second_width = settings.dense
        channels, side = 1 if grey else 3, IMAGE_SIZE
        for _ in settings.filters:
            side = (side - _KERNEL + 1) // 2
        self.layers = nn.Sequential(
            *_convolution(channels, a),
            *_convolution(a, b),
            *_convolution(b, c),
            nn.Flatten(),
            nn.Dropout(settings.dropout),
            nn.Linear(c * side * side, first_width),
            nn.ReLU(),
            nn.Dropout(settings.dropout),
            nn.Linear(first_width, second_width),
            nn.ReLU(),
            nn.Linear(second_width, count),
        )
        self.register_buffer("mean_image", torch.full((channels, IMAGE_SIZE, IMAGE_SIZE), 0.5))
        self.register_buffer("centre", torch.zeros(count))
        self.register_buffer("scale", torch.ones(()))

    def channels(self, image: torch.Tensor) -> torch.Tensor:
        """Return the network's channels of images (B, 3, H, W): all three, or their luma (B, 1, H, W)."""
        if not self.grey:
            return image
        # R, G, B in a grey image (ITU-R BT.601)
        return (image * image.new_tensor((0.299, 0.587, 0.114))[:, None, None]).sum(1, keepdim=True)

    def forward(self, image: torch.Tensor) -> torch.Tensor:
        return self.layers(self.channels(image) - self.mean_image).float() * self.scale + self.centre


class PaperNetworks(nn.Module):
    """The four networks and their errors: the content of a `Prediction`, from images.

    Attributes:
        azimuth_deviation: () standard deviation of azimuth, radians.
        deviation: (M,) standard deviations of the regressed numbers, light in the heading frame.
    """

    azimuth_deviation: torch.Tensor
    deviation: torch.Tensor

    def __init__(self, settings: PaperSettings):
        super().__init__()
        self.settings = settings
        counts = dict(zip(FACTORS, (4, settings.modes, 3, L_COUNT), strict=True))
        self.factors = nn.ModuleDict(
            {name: FactorNetwork(counts[name], name in ("pose", "shape"), settings) for name in FACTORS}
        )
        self.register_buffer("azimuth_deviation", torch.tensor(1.0))
        self.register_buffer("deviation", torch.ones(regressed_layout(settings.modes).size))

    def of(self, factor: str) -> FactorNetwork:
        """Return one factor's network."""
        network = self.factors[factor]
        assert isinstance(network, FactorNetwork)
        return network

    def numbers(self, image: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Return the azimuth (B,) in radians, and the regressed numbers (B, M), light in the heading frame.

        The light is predicted in the object's frame, as in the paper, and turned by the predicted azimuth.
        """
        pose, shape, albedo, light = (self.factors[name](image) for name in FACTORS)
        azimuth, elevation = torch.atan2(pose[:, 1], pose[:, 0]), torch.atan2(pose[:, 3], pose[:, 2])
        parts = {"shape": shape, "elevation": elevation[:, None], "albedo": albedo}
        parts["light"] = rotate_z(light, -azimuth)
        numbers = regressed_layout(self.settings.modes).join(parts)
        return torch.remainder(azimuth, 2 * math.pi), numbers

    def forward(self, image: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor, torch.Tensor]:
        """Return the fields of a `Prediction` for images (B, 3, 150, 150), sRGB in [0, 1].

        Azimuth is a Gaussian round the circle; the mask is a third for each class, uninformative.
        """
        azimuth, numbers = self.numbers(image)
        labels = azimuth_labels(azimuth, self.settings.azimuth_bins, float(self.azimuth_deviation))
        count, classes = len(image), len(MASK_CLASSES)
        mask = image.new_full((count, IMAGE_SIZE, IMAGE_SIZE, classes), 1 / classes)
        return labels, numbers, self.deviation.repeat(count, 1), mask


def targets_of(latents: Latents) -> dict[str, torch.Tensor]:
    """Return the targets of each factor's network, (B, count).

    Cosine and sine of azimuth and of elevation; shape; albedo; light in the object's frame, the world's.
    """
    azimuth, elevation = latents.azimuth, latents.elevation
    pose = torch.stack([azimuth.cos(), azimuth.sin(), elevation.cos(), elevation.sin()], dim=1)
    return dict(zip(FACTORS, (pose, latents.shape, latents.albedo, latents.light), strict=True))


def networks_from(settings: Mapping[str, Any], tensors: Mapping[str, torch.Tensor]) -> PaperNetworks:
    """Return the networks of a weights file, from its settings and tensors.

    Raises ValueError when these are not of the paper's networks.
    """
    with torch.device("meta"):
        networks = PaperNetworks(decode(PaperSettings, dict(settings)))
    load_network(networks, {name.removeprefix("network."): value for name, value in tensors.items()})
    if not (networks.deviation > 0).all() or not networks.azimuth_deviation > 0:
        raise ValueError("a standard deviation is not positive")
    return networks


def _convolution(inputs: int, outputs: int) -> tuple[nn.Module, ...]:
    """Return ReLU after pooling: the same as before it, as in the paper, in less time."""
    return nn.Conv2d(inputs, outputs, _KERNEL), nn.MaxPool2d(2), nn.ReLU()
