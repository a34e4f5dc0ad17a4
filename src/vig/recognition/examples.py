"""A dataset as a network learns from it: in memory, some rooms held out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch

from vig.dataset import Dataset
from vig.recognition.targets import mask_labels, numbers_of
from vig.scene import Latents

HELD_SHARE = 1 / 16
"""Of the images, at least, whose rooms are held out."""


@dataclass(frozen=True)
class Examples:
    """A dataset in memory.

    images (N, H, W, 3) uint8; azimuth (N,); numbers (N, M); mask (N, 3, h, w) uint8, shares of 255.
    """

    images: torch.Tensor
    azimuth: torch.Tensor
    numbers: torch.Tensor
    mask: torch.Tensor

    @staticmethod
    def of(dataset: Dataset) -> Examples:
        """Read all of a dataset, a few hundred pictures at a time."""
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
        """One after another."""
        columns = zip(*[(p.images, p.azimuth, p.numbers, p.mask) for p in parts], strict=True)
        return Examples(*(torch.cat(column) for column in columns))

    def __len__(self) -> int:
        return len(self.azimuth)

    def __getitem__(self, chosen: torch.Tensor) -> Examples:
        return Examples(self.images[chosen], self.azimuth[chosen], self.numbers[chosen], self.mask[chosen])


def hold_out(dataset: Dataset, most: int) -> tuple[np.ndarray, np.ndarray]:
    """Indices to train on, and at most `most` to validate on, whose rooms no training image shows.

    Whole rooms are held out until they have a sixteenth of the images. A dataset of a single room gives its
    last tenth.
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
