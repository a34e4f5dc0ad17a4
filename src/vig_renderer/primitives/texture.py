"""Texture look-up: bilinear in two levels of a mip pyramid, linear between them (trilinear)."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import torch
import torch.nn.functional as F

from vig_renderer.device import (
    TEMPLATES,
    check_floats,
    check_table,
    instantiate,
    kernel_module,
    launch,
    opaque,
    vector_types,
)
from vig_renderer.once import make_once


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
        self.check()

    def check(self) -> None:
        """ValueError for other shapes or types, or levels that lie beyond the texels."""
        check_floats(texels=(self.texels, (None, None)))
        check_table("levels", self.levels, (None, 3))
        object.__setattr__(self, "levels", self.levels.contiguous())
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


@make_once
def _kernels(dtype: torch.dtype) -> Any:
    return instantiate([TEMPLATES / "texture.py"], kernel_module("texture", dtype), **vector_types(dtype))


def _look_up(kernel: str, *arguments: torch.Tensor) -> torch.Tensor:
    texels, uv = arguments[0], arguments[4]
    result = texels.new_empty(len(uv), texels.shape[1])
    launch(getattr(_kernels(texels.dtype), kernel), len(uv), *arguments, result)
    return result


def _backward(*arguments: torch.Tensor) -> tuple[torch.Tensor, ...]:
    texels, uv, footprint = (arguments[i] for i in (0, 4, 5))
    results = torch.zeros_like(texels), torch.zeros_like(uv), torch.zeros_like(footprint)
    launch(_kernels(texels.dtype).backward, len(uv), *arguments, *results)
    return results


class _Texture(torch.autograd.Function):
    @staticmethod
    def forward(*arguments: torch.Tensor) -> torch.Tensor:
        texels, _, first, texture, uv, footprint = arguments
        shapes = {"uv": (uv, (len(texture), 2)), "footprint": (footprint, (len(texture), 4))}
        check_floats(texels=(texels, (None, None)), **shapes)
        check_table("texture", texture, (None,), len(first) - 1, -1)
        return _look_up("forward", *arguments)

    @staticmethod
    def setup_context(ctx: Any, inputs: tuple[torch.Tensor, ...], output: torch.Tensor) -> None:
        ctx.save_for_backward(*inputs)
        ctx.save_for_forward(*inputs)

    @staticmethod
    def backward(ctx: Any, cotangents: torch.Tensor) -> Any:
        on_texels, on_uv, on_footprint = opaque(_backward, *ctx.saved_tensors, cotangents)
        return on_texels, None, None, None, on_uv, on_footprint

    @staticmethod
    def jvp(
        ctx: Any, texels_moved: Any, _: Any, __: Any, ___: Any, uv_moved: Any, footprint_moved: Any
    ) -> Any:
        texels, levels, first, texture, uv, footprint = ctx.saved_tensors
        uv_moved = torch.zeros_like(uv) if uv_moved is None else uv_moved
        footprint_moved = torch.zeros_like(footprint) if footprint_moved is None else footprint_moved
        result = opaque(_look_up, "tangent", *ctx.saved_tensors, uv_moved, footprint_moved)
        if texels_moved is not None:
            # Linear in the texels; where there is no texture the look-up is the constant one.
            linear = opaque(_look_up, "forward", texels_moved, levels, first, texture, uv, footprint)
            result = result + torch.where(texture[:, None] < 0, torch.zeros_like(linear), linear)
        return result


def sample_texture(
    textures: Pyramid, texture: torch.Tensor, uv: torch.Tensor, footprint: torch.Tensor
) -> torch.Tensor:
    """Look textures up at N points: (N, C), 1 where a point has no texture.

    textures: see `stack_pyramids`. texture (N,) int32: which one, -1 for none. uv (N, 2): (0, 0) is the
    image's lower left corner, (1, 1) its upper right, repeated outside. footprint (N, 2, 2): how uv change
    per pixel to the right, then per pixel downwards. The level of detail is the logarithm of the pixel's root
    mean square size in texels. Differentiable in texels, uv and footprint. Raises ValueError for other shapes
    and types and for textures that are not there.
    """
    look_up: Callable[..., torch.Tensor] = _Texture.apply
    return look_up(
        textures.texels.contiguous(),
        textures.levels,
        textures.first,
        texture.contiguous(),
        uv.contiguous(),
        footprint.reshape(-1, 4).contiguous(),
    )
