"""Texture look-up: bilinear in two levels of a mip pyramid, linear between them (trilinear)."""

from typing import Any

import torch
import warp as wp

from vig.renderer.device import scalar_type
from vig.renderer.primitives.arguments import check_floats, check_table
from vig.renderer.primitives.opaque import array_of, device_of, opaque
from vig.renderer.primitives.pyramid import Pyramid
from vig.renderer.primitives.texture_kernels import texture_kernels


def _run(name: str, arguments: tuple[torch.Tensor, ...], more: list[Any], outputs: list[Any]) -> None:
    texels, levels, first, texture, uv, footprint = arguments
    kernels = texture_kernels(texels.dtype)
    inputs = [
        array_of(texels, kernels.real),
        array_of(levels, wp.int32),
        array_of(first, wp.int32),
        array_of(texture, wp.int32),
        array_of(uv, kernels.vec2),
        array_of(footprint, kernels.vec4),
        *more,
    ]
    kernel = getattr(kernels, name)
    wp.launch(kernel, dim=len(uv), inputs=inputs, outputs=outputs, device=device_of(uv))


def _forward(*arguments: torch.Tensor) -> torch.Tensor:
    texels, uv = arguments[0], arguments[4]
    result = texels.new_empty(len(uv), texels.shape[1])
    _run("forward", arguments, [], [array_of(result, scalar_type(texels.dtype))])
    return result


def _backward(*arguments: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    *inputs, cotangents = arguments
    kernels = texture_kernels(inputs[0].dtype)
    on_texels, on_uv, on_footprint = (torch.zeros_like(inputs[i]) for i in (0, 4, 5))
    outputs = [
        array_of(on_texels, kernels.real),
        array_of(on_uv, kernels.vec2),
        array_of(on_footprint, kernels.vec4),
    ]
    _run("backward", tuple(inputs), [array_of(cotangents, kernels.real)], outputs)
    return on_texels, on_uv, on_footprint


def _tangent(*arguments: torch.Tensor) -> torch.Tensor:
    *inputs, uv_moved, footprint_moved = arguments
    kernels = texture_kernels(inputs[0].dtype)
    result = inputs[0].new_empty(len(uv_moved), inputs[0].shape[1])
    moved = [array_of(uv_moved, kernels.vec2), array_of(footprint_moved, kernels.vec4)]
    _run("tangent", tuple(inputs), moved, [array_of(result, kernels.real)])
    return result


class _Texture(torch.autograd.Function):
    @staticmethod
    def forward(*arguments: torch.Tensor) -> torch.Tensor:
        texels, _, first, texture, uv, footprint = arguments
        shapes = {"uv": (uv, (len(texture), 2)), "footprint": (footprint, (len(texture), 4))}
        check_floats(texels=(texels, (None, None)), **shapes)
        check_table("texture", texture, (None,), len(first) - 1, -1)
        return _forward(*arguments)

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
        result = opaque(_tangent, *ctx.saved_tensors, uv_moved, footprint_moved)
        if texels_moved is not None:
            # Linear in the texels; where there is no texture the look-up is the constant one.
            linear = opaque(_forward, texels_moved, levels, first, texture, uv, footprint)
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
    return _Texture.apply(
        textures.texels.contiguous(),
        textures.levels,
        textures.first,
        texture.contiguous(),
        uv.contiguous(),
        footprint.reshape(-1, 4).contiguous(),
    )
