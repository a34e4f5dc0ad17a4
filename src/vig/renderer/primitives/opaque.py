"""How kernels meet torch: calls that autograd and torch.func see as one step."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import torch
import warp as wp

from vig.renderer.device import initialise


class _Opaque(torch.autograd.Function):
    @staticmethod
    def forward(run: Callable[..., Any], *arguments: Any) -> Any:
        return run(*arguments)

    @staticmethod
    def setup_context(ctx: Any, inputs: tuple[Any, ...], output: Any) -> None:
        pass

    @staticmethod
    def backward(ctx: Any, *cotangents: Any) -> Any:
        raise NotImplementedError("the renderer has first derivatives only; a second one was asked for")

    @staticmethod
    def jvp(ctx: Any, *tangents: Any) -> Any:
        raise NotImplementedError("the renderer has first derivatives only; a second one was asked for")


def opaque(run: Callable[..., Any], *arguments: Any) -> Any:
    """Call `run` on plain, contiguous tensors, also where a transform of torch.func has wrapped them.

    run launches kernels: torch sees nothing of what it does. A derivative through it is refused, so that
    a second derivative of the renderer is an error and not silently zero.
    """
    initialise()
    return _Opaque.apply(run, *(a.contiguous() if isinstance(a, torch.Tensor) else a for a in arguments))


def array_of(tensor: torch.Tensor, dtype: type) -> Any:
    """What a kernel takes for a contiguous tensor, no copy: a bare descriptor, faster made than an array.

    The tensor must live until the kernel has been launched.
    """
    return wp.from_torch(tensor, dtype=dtype, requires_grad=False, return_ctype=True)


def device_of(tensor: torch.Tensor) -> str:
    """The tensor's device as Warp names it."""
    return str(tensor.device)


def kernel_module(room: str, dtype: torch.dtype) -> str:
    """The name under which a file's kernels of one scalar type are cached."""
    return f"vig_{room}_{str(dtype).removeprefix('torch.')}"
