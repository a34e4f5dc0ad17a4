"""Training examples in memory, and the images of rooms that are held out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch

from vig.scene import Latents
from vig_lab.training.targets import mask_labels, numbers_of
from vig_world.dataset import Dataset

HELD_SHARE = 1 / 16
"""Of the images, at least, whose rooms are held out."""


@dataclass(frozen=True)
class Examples:
    """A dataset in memory.

    Attributes:
        images: (N, H, W, 3) uint8, sRGB.
        azimuth: (N,) radians.
        numbers: (N, M), see `targets.numbers_of`.
        mask: (N, 3, h, w) uint8, shares of 255, see `targets.mask_labels`.
    """

    images: torch.Tensor
    azimuth: torch.Tensor
    numbers: torch.Tensor
    mask: torch.Tensor

    @staticmethod
    def of(dataset: Dataset) -> Examples:
        """Read a dataset, a few hundred images at a time."""
        latents = Latents.from_vector(torch.from_numpy(dataset.latents))
        images, masks = [], []
        for some in np.array_split(np.arange(len(dataset)), max(1, len(dataset) // 256)):
            images.append(torch.from_numpy(dataset.read("rgb", some)))
            amodal = torch.from_numpy(dataset.read("mask", some))
            visible = torch.from_numpy(dataset.read("mask_visib", some))
            masks.append((mask_labels(amodal, visible) * 255).round().to(torch.uint8))
        return Examples(torch.cat(images), latents.azimuth, numbers_of(latents), torch.cat(masks))

    @staticmethod
    def joined(parts: list[Examples]) -> Examples:
        """Concatenate."""
        columns = zip(*[(p.images, p.azimuth, p.numbers, p.mask) for p in parts], strict=True)
        return Examples(*(torch.cat(column) for column in columns))

    def __len__(self) -> int:
        return len(self.azimuth)

    def pixels(self, device: torch.device | str = "cpu") -> torch.Tensor:
        """Network input (N, 3, H, W), sRGB in [0, 1]."""
        images = self.images.permute(0, 3, 1, 2).float().div(255).to(device)
        return images.contiguous(memory_format=torch.channels_last)

    def __getitem__(self, chosen: torch.Tensor) -> Examples:
        return Examples(self.images[chosen], self.azimuth[chosen], self.numbers[chosen], self.mask[chosen])


def hold_out(dataset: Dataset, most: int) -> tuple[np.ndarray, np.ndarray]:
    """Indices to train on, and at most `most` to validate on, whose rooms no training image shows.

    Whole rooms are held out until they have `HELD_SHARE` of the images; of a single room, its last tenth.
    """
    rooms = np.array([spec.room.layout for spec in dataset.specs()])
    known, counts = np.unique(rooms, return_counts=True)
    if len(known) == 1:
        held = np.arange(len(rooms)) >= len(rooms) - max(1, len(rooms) // 10)
    else:
        order = np.random.default_rng(np.random.SeedSequence([len(rooms)])).permutation(len(known))
        enough = int(np.searchsorted(counts[order].cumsum(), HELD_SHARE * len(rooms))) + 1
        held = np.isin(rooms, known[order[: min(enough, len(known) - 1)]])
    return np.flatnonzero(~held), np.flatnonzero(held)[:most]
