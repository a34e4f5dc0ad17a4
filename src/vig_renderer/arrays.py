"""Arrays of numpy or, of a caller who has torch, tensors: which they are, and constants of the same kind."""

import sys
from typing import Any, TypeAlias

import numpy as np

Array: TypeAlias = Any  # an array of numpy or a tensor of torch


def is_tensor(value: Any) -> bool:
    """Return whether the value is a tensor of torch, which is not loaded for the question."""
    torch = sys.modules.get("torch")
    return torch is not None and isinstance(value, getattr(torch, "Tensor", ()))


def namespace(array: Any) -> Any:
    """Return the module with the functions of an array: numpy, or torch for a caller's tensors.

    Functions written with it (scenes, not fits) also take tensors of torch, and are differentiated there.
    """
    return sys.modules["torch"] if is_tensor(array) else np


def floating(value: Any) -> Array:
    """Return a tensor as it is; anything else as an array of floating-point numbers."""
    if is_tensor(value):
        return value
    array = np.asarray(value)
    return array if np.issubdtype(array.dtype, np.floating) else array.astype(np.float64)


def like(array: Array, value: Any) -> Array:
    """Return numbers as an array or tensor of another's kind, dtype and device; derivatives are kept."""
    if not is_tensor(array):
        return np.asarray(value, array.dtype)
    if is_tensor(value):
        return value.to(array)
    return sys.modules["torch"].as_tensor(value, dtype=array.dtype, device=array.device)
