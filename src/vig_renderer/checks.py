"""Checks of arrays and tensors, whose errors state the expectation and the argument."""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import torch


def check_indices(name: str, indices: Any, count: int, least: int = 0) -> None:
    """Raise ValueError unless all of an integer array or tensor lie in [least, count)."""
    if 0 in indices.shape:
        return
    low, high = int(indices.min()), int(indices.max())
    if low < least or high >= count:
        raise ValueError(f"{name} must be from {least} to {count - 1}; they are from {low} to {high}")


def check_table(name: str, table: "torch.Tensor", shape: tuple[int | None, ...]) -> None:
    """Raise ValueError unless a table is int32, of a shape (None: any size), on the processor."""
    if type(table).__module__.split(".")[0] != "torch":
        raise ValueError(f"{name} must be a torch tensor; got a {type(table).__name__}")
    _check_shape(name, table, shape)
    if str(table.dtype) != "torch.int32" or table.device.type != "cpu":
        raise ValueError(f"{name} must be int32 on the processor; got {table.dtype} on {table.device}")


def check_floats(**tensors: "tuple[torch.Tensor, tuple[int | None, ...]]") -> None:
    """Raise ValueError unless tensors have their shapes (None: any size) and one type, float32 or float64."""
    first = next(iter(tensors.values()))[0]
    for name, (tensor, shape) in tensors.items():
        _check_shape(name, tensor, shape)
        if str(tensor.dtype) not in ("torch.float32", "torch.float64") or tensor.dtype != first.dtype:
            raise ValueError(f"{name} must be float32 or float64, all of one type; got {tensor.dtype}")


def _check_shape(name: str, tensor: "torch.Tensor", shape: tuple[int | None, ...]) -> None:
    fits = tensor.ndim == len(shape) and all(
        want in (None, have) for want, have in zip(shape, tensor.shape, strict=True)
    )
    if not fits:
        wanted = ", ".join("any" if size is None else str(size) for size in shape)
        raise ValueError(f"{name} must be ({wanted}); got {tuple(tensor.shape)}")
