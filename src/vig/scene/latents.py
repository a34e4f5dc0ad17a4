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
        found = {
            name: tuple(value.shape) if isinstance(value, torch.Tensor) else f"a {type(value).__name__}"
            for name, value in vars(self).items()
        }
        first = found["shape"]
        count, modes = first if isinstance(first, tuple) and len(first) == 2 else (None, None)
        wanted = ((count, modes), (count,), (count,), (count, 3), (count, L_COUNT))
        if tuple(found.values()) != wanted:
            raise ValueError(
                "latents must be tensors shape (B, K), azimuth (B,), elevation (B,), albedo (B, 3),"
                f" light (B, {L_COUNT}); got {', '.join(f'{name} {came}' for name, came in found.items())}."
                " Give each one row an image."
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
            wanted, came = f"(B, K + {latent_layout(0).size})", tuple(vector.shape)
            raise ValueError(f"latents must be {wanted}; got {came}. Give a row an image.")
        parts = layout_of_width(vector.shape[1]).split(vector)
        parts |= {name: parts[name][:, 0] for name in ("azimuth", "elevation")}
        return Latents(**parts)
