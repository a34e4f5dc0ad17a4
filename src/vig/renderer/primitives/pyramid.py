"""Mip pyramids: textures and their box-averaged smaller copies, laid flat for the kernels."""

from __future__ import annotations

from dataclasses import dataclass

import torch
import torch.nn.functional as F

from vig.renderer.kernel_calls import check_floats, check_table


@dataclass(frozen=True)
class Pyramid:
    """One or several textures with their mip levels, flat.

    texels (T, C): all levels one after the other, each row by row. levels (L, 3) int32: first texel, height
    and width of a level. first (n + 1,) int32: texture i has levels first[i] up to first[i + 1].
    """

    texels: torch.Tensor
    levels: torch.Tensor
    first: torch.Tensor

    def __post_init__(self) -> None:
        check_floats(texels=(self.texels, (None, None)))
        check_table("levels", self.levels, (None, 3))
        check_table("first", self.first, (None,), len(self.levels) + 1)
        start, height, width = self.levels.long().unbind(1)
        ends = start + height * width
        whole = (self.levels >= 0).all() and bool((self.levels[:, 1:] >= 1).all())
        if not whole or (ends > len(self.texels)).any() or (self.first[1:] <= self.first[:-1]).any():
            raise ValueError("levels must lie within the texels, and each texture must have one or more")


def pyramid(texture: torch.Tensor) -> Pyramid:
    """Mip levels of one texture (H, W, C), linear values: each half the one before, box-averaged, to 1 x 1.

    Differentiable in the texture. Make it once for a texture that stays the same.
    """
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
    device = texture.device
    return Pyramid(
        torch.cat(parts),
        torch.tensor(table, dtype=torch.int32, device=device),
        torch.tensor([0, len(table)], dtype=torch.int32, device=device),
    )


def stack_pyramids(pyramids: list[Pyramid]) -> Pyramid:
    """Several textures as one: texture i of the result is the i-th of the list."""
    if len(pyramids) == 1:
        return pyramids[0]
    starts, counts = [0], [0]
    for each in pyramids:
        starts.append(starts[-1] + len(each.texels))
        counts.append(counts[-1] + len(each.levels))
    shift = torch.tensor([[1, 0, 0]], dtype=torch.int32, device=pyramids[0].levels.device)
    return Pyramid(
        torch.cat([each.texels for each in pyramids]),
        torch.cat([each.levels + start * shift for each, start in zip(pyramids, starts, strict=False)]),
        torch.tensor(counts, dtype=torch.int32, device=shift.device),
    )
