"""How kernels meet torch: what is checked before a kernel runs, and calls that autograd sees as one step."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import torch
import warp as wp

from vig.checks import check_indices
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
    apply: Callable[..., Any] = _Opaque.apply
    return apply(run, *(a.contiguous() if isinstance(a, torch.Tensor) else a for a in arguments))


def launch(kernel: wp.Kernel, count: int | tuple[int, ...], *arguments: Any) -> None:
    """Run a kernel on `count` threads of its tensors' device.

    Args:
        kernel: Its array arguments are annotated `wp.array(dtype=...)`.
        count: Threads along each axis.
        arguments: In the kernel's order; a contiguous tensor becomes an array of the annotated type, no copy.
    """
    device = next(str(given.device) for given in arguments if isinstance(given, torch.Tensor))
    kinds = kernel.func.__annotations__.values()
    inputs = [
        # A bare descriptor, faster made than an array; the tensor lives until the kernel has been launched.
        wp.from_torch(given, dtype=kind.dtype, requires_grad=False, return_ctype=True)
        if isinstance(given, torch.Tensor)
        else given
        for given, kind in zip(arguments, kinds, strict=True)
    ]
    wp.launch(kernel, dim=count, inputs=inputs, device=device)


def kernel_module(part: str, dtype: torch.dtype) -> str:
    """The name under which a file's kernels of one scalar type are cached."""
    return f"vig_{part}_{str(dtype).removeprefix('torch.')}"


def check_floats(**tensors: tuple[torch.Tensor, tuple[int | None, ...]]) -> None:
    """ValueError unless all tensors have their shapes (None: any size) and one type, float32 or float64."""
    first = next(iter(tensors.values()))[0]
    for name, (tensor, shape) in tensors.items():
        _check_shape(name, tensor, shape)
        if tensor.dtype not in (torch.float32, torch.float64) or tensor.dtype != first.dtype:
            raise ValueError(f"{name} must be float32 or float64, all of one type; got {tensor.dtype}")
        if tensor.device != first.device:
            raise ValueError(f"{name} must be on {first.device} like the others; got {tensor.device}")


def check_table(
    name: str, table: torch.Tensor, shape: tuple[int | None, ...], count: int | None = None, least: int = 0
) -> None:
    """ValueError unless a table is int32, of a shape (None: any size), and names rows least to count - 1.

    count: None leaves the rows unchecked, where they come from a table that was checked.
    """
    _check_shape(name, table, shape)
    if table.dtype != torch.int32:
        raise ValueError(f"{name} must be int32; got {table.dtype}")
    if count is not None:
        check_indices(name, table, count, least)


def check_size(size: tuple[int, int, int]) -> None:
    """ValueError unless a size is of images, rows and columns, one or more of each."""
    if len(size) != 3 or min(size) < 1:
        raise ValueError(f"size must be images, rows and columns, at least one of each; got {tuple(size)}")


def _check_shape(name: str, tensor: torch.Tensor, shape: tuple[int | None, ...]) -> None:
    fits = tensor.ndim == len(shape) and all(
        want in (None, have) for want, have in zip(shape, tensor.shape, strict=True)
    )
    if not fits:
        wanted = ", ".join("any" if size is None else str(size) for size in shape)
        raise ValueError(f"{name} must be ({wanted}); got {tuple(tensor.shape)}")
