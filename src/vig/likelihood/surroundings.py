"""What the rest of a photo looks like: the density of its colours, in place of the paper's uniform U.

Under U = 1 any smooth patch of background that the object could be stretched over gains more than seven
nats a pixel for being explained. A density of the photo's own colours outside the object takes that gain
away: a pixel must fit the object better than it fits what surrounds it.
"""

from __future__ import annotations

import torch
from torch.nn import functional

CELLS = 24
"""Cells of the colour cube along each channel: about the robust model's noise, 0.03, each."""

FLOOR = 0.05
"""Share of the uniform density, for colours that the photo does not show elsewhere."""


def log_colour_density(photo: torch.Tensor, weight: torch.Tensor) -> torch.Tensor:
    """Log density of each pixel's colour among the surroundings, relative to uniform on the cube: (H, W).

    photo (H, W, 3) linear RGB in [0, 1]; weight (H, W) >= 0: how surely each pixel belongs to the
    surroundings. A trilinear histogram, smoothed by one cell; exact sums in float64, so that the result does
    not depend on threads.
    """
    colours = photo.reshape(-1, 3).double().clamp(0, 1) * (CELLS - 1)
    shares = weight.reshape(-1).double() / weight.double().sum().clamp_min(1e-9)
    low = colours.floor().clamp(max=CELLS - 2)
    part = colours - low
    corners, factors = [], []
    for corner in range(8):
        offset = torch.tensor([corner & 1, corner >> 1 & 1, corner >> 2 & 1], dtype=torch.float64)
        at = (low + offset).long()
        corners.append((at[:, 0] * CELLS + at[:, 1]) * CELLS + at[:, 2])
        factors.append((offset * part + (1 - offset) * (1 - part)).prod(1))
    density = torch.zeros(CELLS**3, dtype=torch.float64)
    for at, factor in zip(corners, factors, strict=True):
        density.index_add_(0, at, shares * factor)
    density = _smooth(density.view(CELLS, CELLS, CELLS) / _volume()).reshape(-1)
    looked_up = sum(density[at] * factor for at, factor in zip(corners, factors, strict=True))
    return torch.log(FLOOR + (1 - FLOOR) * torch.as_tensor(looked_up)).view(photo.shape[:2])


def _volume() -> torch.Tensor:
    """Volume (C, C, C) that each node of the histogram stands for: halves at a face of the colour cube."""
    length = torch.full((CELLS,), 1 / (CELLS - 1), dtype=torch.float64)
    length[[0, -1]] /= 2
    return length[:, None, None] * length[:, None] * length


def _smooth(cube: torch.Tensor) -> torch.Tensor:
    """A binomial kernel (1, 2, 1) / 4 along each axis, borders reflected: the integral stays what it is."""
    kernel = torch.tensor([0.25, 0.5, 0.25], dtype=cube.dtype).view(1, 1, 3)
    for axis in range(3):
        moved = cube.movedim(axis, -1)
        lines = functional.pad(moved.reshape(-1, 1, CELLS), (1, 1), mode="reflect")
        cube = functional.conv1d(lines, kernel).view(moved.shape).movedim(-1, axis)
    return cube
