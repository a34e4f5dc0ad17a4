"""Interpolation of vertex attributes at the seen points."""

import functools
from types import SimpleNamespace
from typing import Any

import torch
import warp as wp

from vig.renderer.device import initialise, scalar_type
from vig.renderer.kernel_calls import check_floats, check_table, kernel_module, launch, opaque


@functools.cache
def _kernels(dtype: torch.dtype) -> SimpleNamespace:
    initialise()
    real = scalar_type(dtype)
    module = kernel_module("interpolate", dtype)

    @wp.kernel(module=module)
    def forward(
        attributes: wp.array2d(dtype=real),
        corners: wp.array2d(dtype=wp.int32),
        weights: wp.array2d(dtype=real),
        result: wp.array2d(dtype=real),
    ):
        row = wp.tid()
        a = corners[row, 0]
        b = corners[row, 1]
        c = corners[row, 2]
        u = weights[row, 0]
        v = weights[row, 1]
        w = weights[row, 2]
        for channel in range(attributes.shape[1]):
            result[row, channel] = (
                u * attributes[a, channel] + v * attributes[b, channel] + w * attributes[c, channel]
            )

    @wp.kernel(module=module)
    def backward(
        attributes: wp.array2d(dtype=real),
        corners: wp.array2d(dtype=wp.int32),
        weights: wp.array2d(dtype=real),
        cotangents: wp.array2d(dtype=real),
        on_attributes: wp.array2d(dtype=real),
        on_weights: wp.array2d(dtype=real),
    ):
        row = wp.tid()
        for corner in range(3):
            vertex = corners[row, corner]
            weight = weights[row, corner]
            total = real(0.0)
            for channel in range(attributes.shape[1]):
                cotangent = cotangents[row, channel]
                total = total + cotangent * attributes[vertex, channel]
                wp.atomic_add(on_attributes, vertex, channel, weight * cotangent)
            on_weights[row, corner] = total

    return SimpleNamespace(forward=forward, backward=backward)


def _forward(attributes: torch.Tensor, corners: torch.Tensor, weights: torch.Tensor) -> torch.Tensor:
    result = attributes.new_empty(len(corners), attributes.shape[1])
    launch(_kernels(attributes.dtype).forward, len(corners), attributes, corners, weights, result)
    return result


def _backward(
    attributes: torch.Tensor, corners: torch.Tensor, weights: torch.Tensor, cotangents: torch.Tensor
) -> tuple[torch.Tensor, torch.Tensor]:
    results = torch.zeros_like(attributes), torch.empty_like(weights)
    kernel = _kernels(attributes.dtype).backward
    launch(kernel, len(corners), attributes, corners, weights, cotangents, *results)
    return results


class _Interpolate(torch.autograd.Function):
    @staticmethod
    def forward(attributes: torch.Tensor, corners: torch.Tensor, weights: torch.Tensor) -> torch.Tensor:
        check_floats(attributes=(attributes, (None, None)), weights=(weights, (len(corners), 3)))
        check_table("corners", corners, (None, 3), len(attributes))
        return _forward(attributes, corners, weights)

    @staticmethod
    def setup_context(ctx: Any, inputs: tuple[torch.Tensor, ...], output: torch.Tensor) -> None:
        ctx.save_for_backward(*inputs)
        ctx.save_for_forward(*inputs)

    @staticmethod
    def backward(ctx: Any, cotangents: torch.Tensor) -> Any:
        on_attributes, on_weights = opaque(_backward, *ctx.saved_tensors, cotangents)
        return on_attributes, None, on_weights

    @staticmethod
    def jvp(ctx: Any, attributes_moved: Any, _: Any, weights_moved: Any) -> torch.Tensor:
        attributes, corners, weights = ctx.saved_tensors
        # Bilinear: the product rule.
        result = attributes.new_zeros(len(corners), attributes.shape[1])
        if attributes_moved is not None:
            result = result + opaque(_forward, attributes_moved, corners, weights)
        if weights_moved is not None:
            result = result + opaque(_forward, attributes, corners, weights_moved)
        return result


def interpolate(attributes: torch.Tensor, corners: torch.Tensor, weights: torch.Tensor) -> torch.Tensor:
    """Interpolate vertex attributes at N seen points: sum_i weights[n, i] attributes[corners[n, i]].

    attributes (V, C) float32 or float64. corners (N, 3) int32. weights (N, 3): barycentric weights, or their
    derivatives along the screen, for the attributes' own. Result (N, C). Differentiable in attributes and
    weights. Raises ValueError for other shapes and types and for corners that are not there.
    """
    return _Interpolate.apply(attributes.contiguous(), corners.contiguous(), weights.contiguous())
