"""Training examples in memory, and the images of rooms that are held out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import torch

from vig.scene import Latents
from vig_train.training.targets import TensorRows, cell_shares, numbers_of
from vig_world.dataset import Dataset

HELD_OUT_SHARE = 1 / 16  # least share of the images whose rooms are held out


@dataclass(frozen=True)
class Examples(TensorRows):
    """Images with their truth, in memory.

    Attributes:
        images: (N, H, W, 3) uint8, sRGB.
        azimuth: (N,) radians.
        numbers: (N, M), see `targets.numbers_of`.
        roll: (N,) clockwise turn of the image, radians.
        visible: (N, H, W) uint8, the share of each pixel in which the object is seen, of 255.
        hidden: (N, H, W) uint8, the share in which something before it is.
    """

    images: torch.Tensor
    azimuth: torch.Tensor
    numbers: torch.Tensor
    roll: torch.Tensor
    visible: torch.Tensor
    hidden: torch.Tensor

    @staticmethod
    def of(dataset: Dataset) -> Examples:
        """Read a dataset, a few hundred images at a time, cut to the size of networks' inputs."""
        dataset = dataset.at_network_size()
        latents = Latents.from_vector(torch.from_numpy(dataset.latents))
        images, visible, hidden = [], [], []
        for chunk in np.array_split(np.arange(len(dataset)), max(1, len(dataset) // 256)):
            images.append(torch.from_numpy(dataset.read("rgb", chunk)))
            amodal, visible_pixels = dataset.read("mask", chunk), dataset.read("mask_visib", chunk)
            visible.append(torch.from_numpy(visible_pixels.astype(np.uint8) * 255))
            hidden.append(torch.from_numpy((amodal & ~visible_pixels).astype(np.uint8) * 255))
        masks = torch.cat(visible), torch.cat(hidden)
        roll = torch.tensor(dataset.roll).float()
        return Examples(torch.cat(images), latents.azimuth, numbers_of(latents), roll, *masks)

    @staticmethod
    def concatenate(parts: list[Examples]) -> Examples:
        """Concatenate."""
        columns = zip(*(vars(part).values() for part in parts), strict=True)
        return Examples(*map(torch.cat, columns))

    @staticmethod
    def of_arrays(arrays: Mapping[str, np.ndarray]) -> Examples:
        """Return the examples whose `arrays` these are."""
        return Examples(**{name: torch.from_numpy(value) for name, value in arrays.items()})

    def arrays(self) -> dict[str, np.ndarray]:
        """Return all fields as arrays, which can be sent to another process."""
        return {name: value.numpy() for name, value in vars(self).items()}

    def __len__(self) -> int:
        return len(self.azimuth)

    def pixels(self, device: torch.device | str = "cpu") -> torch.Tensor:
        """Return network input (N, 3, H, W), sRGB in [0, 1]."""
        images = self.images.permute(0, 3, 1, 2).float().div(255).to(device)
        return images.contiguous(memory_format=torch.channels_last)

    def mask(self) -> torch.Tensor:
        """Return shares (N, 3, h, w) of the mask head's cells."""
        return cell_shares(self.visible.float() / 255, self.hidden.float() / 255)

    def present(self) -> torch.Tensor:
        """Return whether an image shows the object at all: (N,) float, 0 or 1."""
        return (self.visible.flatten(1).amax(1) > 127).float()

    def as_absent(self, numbers: int) -> Examples:
        """Return the same images for a class of so many regressed numbers, whose object they do not show."""
        nothing = torch.zeros_like(self.visible)
        unknown = self.numbers.new_zeros(len(self), numbers)
        return Examples(self.images, self.azimuth, unknown, self.roll, nothing, nothing)


def hold_out(datasets: Sequence[Dataset], max_validation: int) -> tuple[np.ndarray, np.ndarray]:
    """Split indices into those to train on and those to validate on, in rooms that no training image shows.

    Indices run through all datasets in their order. Whole rooms are held out until they have `HELD_OUT_SHARE`
    of the images; of a single room, its last tenth. At most `max_validation` indices are to validate on.
    """
    rooms = np.array([spec.room.layout for dataset in datasets for spec in dataset.specs()])
    rooms = np.where(rooms < 0, -1 - np.arange(len(rooms)), rooms)  # each image of the studio is its own
    distinct_rooms, counts = np.unique(rooms, return_counts=True)
    if len(distinct_rooms) == 1:
        held_out = np.arange(len(rooms)) >= len(rooms) - max(1, len(rooms) // 10)
    else:
        order = np.random.default_rng(np.random.SeedSequence([len(rooms)])).permutation(len(distinct_rooms))
        room_count = int(np.searchsorted(counts[order].cumsum(), HELD_OUT_SHARE * len(rooms))) + 1
        held_out = np.isin(rooms, distinct_rooms[order[: min(room_count, len(distinct_rooms) - 1)]])
    held_out_indices = np.flatnonzero(held_out)
    return np.flatnonzero(~held_out), held_out_indices[
        np.linspace(0, len(held_out_indices) - 1, min(max_validation, len(held_out_indices))).astype(int)
    ]
