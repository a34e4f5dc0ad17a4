"""Checks of tables whose numbers kernels follow without looking."""

from __future__ import annotations

from typing import Any


def check_indices(name: str, indices: Any, count: int, least: int = 0) -> None:
    """ValueError unless all of an integer array or tensor lie in [least, count)."""
    if 0 in indices.shape:
        return
    low, high = int(indices.min()), int(indices.max())
    if low < least or high >= count:
        raise ValueError(f"{name} must be from {least} to {count - 1}; they are from {low} to {high}")
