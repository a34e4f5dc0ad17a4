"""The one place where sRGB files meet linear light (IEC 61966-2-1)."""

from __future__ import annotations

from typing import TypeVar

import numpy as np
import torch

ArrayT = TypeVar("ArrayT", np.ndarray, torch.Tensor)


def linear_from_srgb(srgb: ArrayT) -> ArrayT:
    """Decode sRGB values in [0, 1] to linear light in [0, 1], elementwise."""
    if isinstance(srgb, torch.Tensor):
        return torch.where(srgb <= 0.04045, srgb / 12.92, ((srgb.clamp_min(0.0) + 0.055) / 1.055) ** 2.4)
    return np.where(srgb <= 0.04045, srgb / 12.92, ((np.maximum(srgb, 0.0) + 0.055) / 1.055) ** 2.4)


def srgb_from_linear(linear: ArrayT) -> ArrayT:
    """Encode linear light in [0, 1] as sRGB in [0, 1], elementwise; values outside are clipped."""
    if isinstance(linear, torch.Tensor):
        clipped = linear.clamp(0.0, 1.0)
        return torch.where(
            clipped <= 0.0031308, clipped * 12.92, 1.055 * clipped.clamp_min(1e-12) ** (1 / 2.4) - 0.055
        )
    clipped = np.clip(linear, 0.0, 1.0)
    coded: np.ndarray = np.where(clipped <= 0.0031308, clipped * 12.92, 1.055 * clipped ** (1 / 2.4) - 0.055)
    return coded


def srgb8_from_linear(linear: np.ndarray) -> np.ndarray:
    """Encode linear light in [0, 1] as 8-bit sRGB: any shape, uint8."""
    return np.round(srgb_from_linear(np.asarray(linear)) * 255).astype(np.uint8)
