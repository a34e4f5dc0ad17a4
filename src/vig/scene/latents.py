"""The numbers that explain one object in one image."""

from __future__ import annotations

from dataclasses import dataclass, fields

import torch

from vig.scene.layout import latent_layout, layout_of_width
from vig.scene.light import L_COUNT


@dataclass(frozen=True)
class Latents:
    """What is inferred, batched over B images.

    Attributes:
        shape: (B, K) standard deviations along the shape model's components.
        azimuth: (B,) radians.
        elevation: (B,) radians.
        albedo: (B, 3) linear RGB in [0, 1].
        light: (B, 9) SH coefficients of incident radiance in the world frame.
    """

    shape: torch.Tensor
    azimuth: torch.Tensor
    elevation: torch.Tensor
    albedo: torch.Tensor
    light: torch.Tensor

    def __post_init__(self) -> None:
        count = self.azimuth.shape[:1]
        shapes = {name: tuple(value.shape) for name, value in vars(self).items()}
        fits = self.shape.ndim == 2 and self.azimuth.ndim == 1 and shapes["shape"][:1] == count
        fits = fits and self.elevation.shape == count and shapes["albedo"] == (*count, 3)
        if not fits or shapes["light"] != (*count, L_COUNT):
            raise ValueError(
                "latents must be shape (B, K), azimuth (B,), elevation (B,), albedo (B, 3),"
                f" light (B, {L_COUNT}); got " + ", ".join(f"{k} {v}" for k, v in shapes.items())
            )

    def __len__(self) -> int:
        return len(self.azimuth)

    def __getitem__(self, index: slice | torch.Tensor) -> Latents:
        return Latents(*(getattr(self, field.name)[index] for field in fields(self)))

    def to_vector(self) -> torch.Tensor:
        """All latents as (B, P) in the order of `vig.scene.layout.latent_layout`."""
        parts = {field.name: getattr(self, field.name) for field in fields(self)}
        columns = {name: part if part.ndim == 2 else part[:, None] for name, part in parts.items()}
        return latent_layout(self.shape.shape[1]).join(columns)

    @staticmethod
    def from_vector(vector: torch.Tensor) -> Latents:
        """The inverse of `to_vector`; K follows from the width. Raises ValueError on a wrong shape."""
        if vector.ndim != 2 or vector.shape[1] < latent_layout(0).size:
            raise ValueError(f"latents must be (B, K + {latent_layout(0).size}); got {tuple(vector.shape)}")
        parts = layout_of_width(vector.shape[1]).split(vector)
        parts |= {name: parts[name][:, 0] for name in ("azimuth", "elevation")}
        return Latents(**parts)
