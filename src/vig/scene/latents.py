"""The 24 numbers that explain one object in one image."""

from __future__ import annotations

from dataclasses import dataclass

import torch

from vig.scene.light import L_COUNT

SHAPE_LIMIT = 3.0
"""Shape coefficients stay within this many standard deviations."""


@dataclass(frozen=True)
class Latents:
    """What is inferred, batched over B images.

    shape: (B, K) standard deviations along the shape model's components.
    azimuth, elevation: (B,) radians. albedo: (B, 3) linear RGB in [0, 1].
    light: (B, 9) SH coefficients of incident radiance in the world frame.
    """

    shape: torch.Tensor
    azimuth: torch.Tensor
    elevation: torch.Tensor
    albedo: torch.Tensor
    light: torch.Tensor

    def __len__(self) -> int:
        return len(self.azimuth)

    def __getitem__(self, index: slice | torch.Tensor) -> Latents:
        return Latents.from_vector(self.to_vector()[index])

    def to_vector(self) -> torch.Tensor:
        """All latents as (B, P), P = K + 2 + 3 + 9, in the order of the fields."""
        return torch.cat(
            [self.shape, self.azimuth[:, None], self.elevation[:, None], self.albedo, self.light], dim=1
        )

    @staticmethod
    def from_vector(vector: torch.Tensor) -> Latents:
        """The inverse of `to_vector`; K follows from the width. Raises ValueError on a wrong shape."""
        modes = vector.shape[1] - 5 - L_COUNT if vector.ndim == 2 else -1
        if modes < 0:
            raise ValueError(f"latents must be (B, K + 14); got {tuple(vector.shape)}")
        shape, azimuth, elevation, albedo, light = vector.split([modes, 1, 1, 3, L_COUNT], dim=1)
        return Latents(shape, azimuth[:, 0], elevation[:, 0], albedo, light)

    @staticmethod
    def names(modes: int) -> list[str]:
        """A name for each column of `to_vector`, as written in tables."""
        light = [f"light_{degree}_{order}" for degree in range(3) for order in range(-degree, degree + 1)]
        shape = [f"shape_{mode}" for mode in range(modes)]
        return [*shape, "azimuth", "elevation", "albedo_r", "albedo_g", "albedo_b", *light]
