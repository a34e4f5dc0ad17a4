"""Texture look-up: bilinear in two levels of a mip pyramid, linear between them (trilinear)."""

# mypy: disable-error-code="assignment,type-var,no-any-return"

import functools
import math
from collections.abc import Callable
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import torch
import torch.nn.functional as F
import warp as wp

from vig.renderer.device import (
    check_floats,
    check_table,
    initialise,
    kernel_module,
    launch,
    opaque,
    scalar_type,
)


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


@functools.cache
def _kernels(dtype: torch.dtype) -> SimpleNamespace:
    initialise()
    real = scalar_type(dtype)
    vec2, vec4 = wp.types.vector(2, real), wp.types.vector(4, real)
    module = kernel_module("texture", dtype)
    half, one, smallest, per_octave = real(0.5), real(1.0), real(1e-12), real(0.5 / math.log(2.0))

    @wp.struct
    class Quad:
        """Four neighbouring texels and the place between them."""

        i00: wp.int32
        i01: wp.int32
        i10: wp.int32
        i11: wp.int32
        fx: real
        fy: real
        width: real
        height: real

    @wp.func
    def wrapped(i: int, count: int):
        r = i % count
        if r < 0:
            r = r + count
        return r

    @wp.func
    def quad_at(levels: wp.array2d(dtype=wp.int32), level: int, uv: vec2):
        q = Quad()
        start = levels[level, 0]
        height = levels[level, 1]
        width = levels[level, 2]
        q.width = real(width)
        q.height = real(height)
        # Whole turns of the texture are dropped first: large uv must not overflow.
        x = (uv[0] - wp.floor(uv[0])) * q.width - half
        y = (one - (uv[1] - wp.floor(uv[1]))) * q.height - half
        left = wp.floor(x)
        top = wp.floor(y)
        q.fx = x - left
        q.fy = y - top
        x0 = wrapped(int(left), width)
        x1 = wrapped(int(left) + 1, width)
        y0 = wrapped(int(top), height)
        y1 = wrapped(int(top) + 1, height)
        q.i00 = start + y0 * width + x0
        q.i01 = start + y0 * width + x1
        q.i10 = start + y1 * width + x0
        q.i11 = start + y1 * width + x1
        return q

    @wp.func
    def bilinear(texels: wp.array2d(dtype=real), q: Quad, c: int):
        upper = texels[q.i00, c] * (one - q.fx) + texels[q.i01, c] * q.fx
        lower = texels[q.i10, c] * (one - q.fx) + texels[q.i11, c] * q.fx
        return upper * (one - q.fy) + lower * q.fy

    @wp.func
    def slope(texels: wp.array2d(dtype=real), q: Quad, c: int):
        """Derivative of the bilinear value by u and v (v runs up, rows run down)."""
        along_x = (texels[q.i01, c] - texels[q.i00, c]) * (one - q.fy) + (
            texels[q.i11, c] - texels[q.i10, c]
        ) * q.fy
        along_y = (texels[q.i10, c] - texels[q.i00, c]) * (one - q.fx) + (
            texels[q.i11, c] - texels[q.i01, c]
        ) * q.fx
        return vec2(along_x * q.width, -along_y * q.height)

    @wp.func
    def scatter(result: wp.array2d(dtype=real), q: Quad, c: int, cotangent: real):
        wp.atomic_add(result, q.i00, c, cotangent * (one - q.fx) * (one - q.fy))
        wp.atomic_add(result, q.i01, c, cotangent * q.fx * (one - q.fy))
        wp.atomic_add(result, q.i10, c, cotangent * (one - q.fx) * q.fy)
        wp.atomic_add(result, q.i11, c, cotangent * q.fx * q.fy)

    @wp.struct
    class Detail:
        """The two levels used, the share of the coarser, and that share's derivative by the footprint."""

        fine: wp.int32
        coarse: wp.int32
        share: real
        rate: vec4

    @wp.func
    def detail_of(levels: wp.array2d(dtype=wp.int32), begin: int, end: int, footprint: vec4):
        d = Detail()
        d.fine = begin
        d.coarse = begin
        width = real(levels[begin, 2])
        height = real(levels[begin, 1])
        scale = vec4(width * width, height * height, width * width, height * height)
        weighted = wp.cw_mul(scale, footprint)
        # Mean square size of the pixel in texels; half its logarithm is the level.
        square = half * wp.dot(weighted, footprint)
        level = per_octave * wp.log(wp.max(square, smallest))
        if level <= real(0.0):
            return d
        if level >= real(end - begin - 1):
            d.fine = end - 1
            d.coarse = end - 1
            return d
        d.fine = begin + int(wp.floor(level))
        d.coarse = d.fine + 1
        d.share = level - wp.floor(level)
        d.rate = weighted * (per_octave / square)
        return d

    @wp.kernel(module=module)
    def forward(
        texels: wp.array2d(dtype=real),
        levels: wp.array2d(dtype=wp.int32),
        first: wp.array(dtype=wp.int32),
        texture: wp.array(dtype=wp.int32),
        uv: wp.array(dtype=vec2),
        footprint: wp.array(dtype=vec4),
        result: wp.array2d(dtype=real),
    ):
        row = wp.tid()
        which = texture[row]
        if which < 0:
            for c in range(texels.shape[1]):
                result[row, c] = one
            return
        d = detail_of(levels, first[which], first[which + 1], footprint[row])
        fine = quad_at(levels, d.fine, uv[row])
        coarse = quad_at(levels, d.coarse, uv[row])
        for c in range(texels.shape[1]):
            value = bilinear(texels, fine, c)
            if d.share > real(0.0):
                value = value + d.share * (bilinear(texels, coarse, c) - value)
            result[row, c] = value

    @wp.kernel(module=module)
    def backward(
        texels: wp.array2d(dtype=real),
        levels: wp.array2d(dtype=wp.int32),
        first: wp.array(dtype=wp.int32),
        texture: wp.array(dtype=wp.int32),
        uv: wp.array(dtype=vec2),
        footprint: wp.array(dtype=vec4),
        cotangents: wp.array2d(dtype=real),
        on_texels: wp.array2d(dtype=real),
        on_uv: wp.array(dtype=vec2),
        on_footprint: wp.array(dtype=vec4),
    ):
        row = wp.tid()
        which = texture[row]
        if which < 0:
            return
        d = detail_of(levels, first[which], first[which + 1], footprint[row])
        fine = quad_at(levels, d.fine, uv[row])
        coarse = quad_at(levels, d.coarse, uv[row])
        by_uv = vec2()
        by_share = real(0.0)
        for c in range(texels.shape[1]):
            g = cotangents[row, c]
            scatter(on_texels, fine, c, g * (one - d.share))
            by_uv = by_uv + slope(texels, fine, c) * (g * (one - d.share))
            if d.coarse != d.fine:
                scatter(on_texels, coarse, c, g * d.share)
                by_uv = by_uv + slope(texels, coarse, c) * (g * d.share)
                by_share = by_share + g * (bilinear(texels, coarse, c) - bilinear(texels, fine, c))
        on_uv[row] = by_uv
        on_footprint[row] = d.rate * by_share

    @wp.kernel(module=module)
    def tangent(
        texels: wp.array2d(dtype=real),
        levels: wp.array2d(dtype=wp.int32),
        first: wp.array(dtype=wp.int32),
        texture: wp.array(dtype=wp.int32),
        uv: wp.array(dtype=vec2),
        footprint: wp.array(dtype=vec4),
        uv_moved: wp.array(dtype=vec2),
        footprint_moved: wp.array(dtype=vec4),
        result: wp.array2d(dtype=real),
    ):
        row = wp.tid()
        which = texture[row]
        if which < 0:
            for c in range(texels.shape[1]):
                result[row, c] = real(0.0)
            return
        d = detail_of(levels, first[which], first[which + 1], footprint[row])
        fine = quad_at(levels, d.fine, uv[row])
        coarse = quad_at(levels, d.coarse, uv[row])
        share_moved = wp.dot(d.rate, footprint_moved[row])
        for c in range(texels.shape[1]):
            value = wp.dot(slope(texels, fine, c), uv_moved[row]) * (one - d.share)
            if d.coarse != d.fine:
                value = value + wp.dot(slope(texels, coarse, c), uv_moved[row]) * d.share
                value = value + share_moved * (bilinear(texels, coarse, c) - bilinear(texels, fine, c))
            result[row, c] = value

    return SimpleNamespace(forward=forward, backward=backward, tangent=tangent)


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
    look_up: Callable[..., Any] = _Texture.apply
    return look_up(
        textures.texels.contiguous(),
        textures.levels,
        textures.first,
        texture.contiguous(),
        uv.contiguous(),
        footprint.reshape(-1, 4).contiguous(),
    )
