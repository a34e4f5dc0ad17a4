"""Texture look-up: bilinear in two levels of a mip pyramid, linear between them (trilinear)."""

import math
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


def sample_texture(texture: Pyramid, uv: torch.Tensor, footprint: torch.Tensor) -> torch.Tensor:
    """Look a texture up at N points: (N, C), in plain torch.

    uv (N, 2): (0, 0) is the image's lower left corner, (1, 1) its upper right, repeated outside. footprint
    (N, 2, 2): how uv change per pixel to the right, then per pixel downwards. The level of detail is the
    logarithm of the pixel's root mean square size in texels. Differentiable in texels, uv and footprint.
    """
    size = texture.levels[0, [2, 1]].to(uv)
    last = len(texture.levels) - 1
    square = (footprint * size).square().sum(dim=(1, 2)) / 2
    level = 0.5 / math.log(2.0) * square.clamp_min(1e-12).log()
    fine = level.detach().floor().clamp(0, last).long()
    between = (level > 0) & (level < last)
    share = torch.where(between, level - fine, 0.0)[:, None]
    coarse = (fine + 1).clamp_max(last)
    # Trilinear: the two nearest levels, blended (Williams 1983).
    return (1 - share) * _bilinear(texture, fine, uv) + share * _bilinear(texture, coarse, uv)


def _bilinear(texture: Pyramid, level: torch.Tensor, uv: torch.Tensor) -> torch.Tensor:
    start, height, width = texture.levels[level].long().unbind(1)
    # Whole turns of the texture are dropped first: large uv must not overflow. v runs up, rows run down.
    u, v = (uv - uv.detach().floor()).unbind(1)
    x, y = u * width - 0.5, (1 - v) * height - 0.5
    left, top = x.detach().floor().long(), y.detach().floor().long()
    across, down = (x - left)[:, None], (y - top)[:, None]

    def texel(row: torch.Tensor, column: torch.Tensor) -> torch.Tensor:
        return texture.texels.index_select(0, start + row.remainder(height) * width + column.remainder(width))

    upper = (1 - across) * texel(top, left) + across * texel(top, left + 1)
    lower = (1 - across) * texel(top + 1, left) + across * texel(top + 1, left + 1)
    return (1 - down) * upper + down * lower
