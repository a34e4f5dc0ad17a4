"""Texture look-up: bilinear in two levels of a mip pyramid, linear between them (trilinear)."""

from __future__ import annotations

from dataclasses import dataclass

import torch
import torch.nn.functional as F

from vig_renderer.checks import check_floats, check_table


@dataclass(frozen=True)
class Pyramid:
    """A texture with its mip levels, flat.

    texels (T, C): all levels one after the other, each row by row. levels (L, 3) int32: first texel, height
    and width of a level. Raises ValueError for other shapes or types, or levels that lie beyond the texels.
    """

    texels: torch.Tensor
    levels: torch.Tensor

    def __post_init__(self) -> None:
        check_floats(texels=(self.texels, (None, None)))
        check_table("levels", self.levels, (None, 3))
        start, height, width = self.levels.long().unbind(1)
        whole = len(self.levels) > 0 and bool((start >= 0).all() and (self.levels[:, 1:] >= 1).all())
        if not whole or (start + height * width > len(self.texels)).any():
            raise ValueError("levels must lie within the texels, and each texture must have one or more")


def pyramid(texture: torch.Tensor) -> Pyramid:
    """Return mip levels of a texture (H, W, C), linear values: each half the last, box-averaged, to 1 x 1.

    Differentiable in the texture. Make it once for a texture that stays the same.
    """
    if not isinstance(texture, torch.Tensor) or texture.dtype not in (torch.float32, torch.float64):
        raise ValueError(
            "a texture must be a float32 or float64 tensor of linear values; got"
            f" {getattr(texture, 'dtype', type(texture).__name__)}. Of 8-bit sRGB, decode texture / 255."
        )
    if texture.ndim != 3 or min(texture.shape) < 1:
        raise ValueError(f"a texture must be (H, W, C) with at least one texel; got {tuple(texture.shape)}")
    level = texture.permute(2, 0, 1)[None]
    parts, table, start = [], [], 0
    while True:
        height, width = level.shape[2:]
        parts.append(level[0].permute(1, 2, 0).reshape(height * width, -1))
        table.append((start, height, width))
        start += height * width
        if height == width == 1:
            break
        level = F.adaptive_avg_pool2d(level, (max(height // 2, 1), max(width // 2, 1)))
    return Pyramid(torch.cat(parts), torch.tensor(table, dtype=torch.int32, device=texture.device))
