"""What the primitives check of their arguments before a kernel, which cannot, reads them."""

from __future__ import annotations

import torch

from vig.checks import check_indices


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
