"""Light as nine real spherical-harmonic (SH) coefficients, and colour.

Coefficients are of incident radiance in the orthonormal real basis, in the order (l, m) =
(0,0), (1,-1), (1,0), (1,1), (2,-2), ..., (2,2), in the world frame (Z up); `vig_renderer.harmonics` has the
basis and what a surface reflects.
"""

from __future__ import annotations

import math
from typing import TypeVar

import numpy as np
import torch

from vig_renderer.harmonics import COSINE_LOBE as COSINE_LOBE
from vig_renderer.harmonics import L_COUNT as L_COUNT
from vig_renderer.harmonics import Y00 as Y00
from vig_renderer.harmonics import Y1 as Y1
from vig_renderer.harmonics import Y2 as Y2
from vig_renderer.harmonics import Y20 as Y20
from vig_renderer.harmonics import sh_basis as sh_basis

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


EXPOSURE_L00 = 0.75 * math.pi
"""L00 of every light after exposure: the paper's 0.75 in its units, which lack the 1 / pi."""


def irradiance(light: torch.Tensor, normals: torch.Tensor) -> torch.Tensor:
    """What a white Lambertian surface reflects (irradiance / pi, Eq. 1 with SH light).

    light: (..., 9); normals: (..., 3) unit, broadcast against light's leading axes. Result >= 0.
    """
    lobe = torch.tensor(COSINE_LOBE, dtype=light.dtype, device=light.device)
    return ((light * lobe) * sh_basis(normals)).sum(-1).clamp_min(0.0)


def rotate_z(light: torch.Tensor, angle: torch.Tensor | float) -> torch.Tensor:
    """Light turned by `angle` radians about +Z, counter-clockwise: (..., 9), angle (...) or a number.

    The turned light in direction d is the given light in direction Rz(-angle) d.
    """
    angle = torch.as_tensor(angle, dtype=light.dtype, device=light.device)
    c1, s1, c2, s2 = torch.cos(angle), torch.sin(angle), torch.cos(2 * angle), torch.sin(2 * angle)
    l00, y, z, x, xy, yz, zz, xz, x2y2 = light.unbind(-1)
    return torch.stack(
        [
            l00,
            c1 * y + s1 * x,
            z,
            c1 * x - s1 * y,
            c2 * xy + s2 * x2y2,
            c1 * yz + s1 * xz,
            zz,
            c1 * xz - s1 * yz,
            c2 * x2y2 - s2 * xy,
        ],
        dim=-1,
    )


def rotations_z(angle: torch.Tensor) -> torch.Tensor:
    """Matrices of `rotate_z`: (B,) radians to (B, 9, 9), so that rotations_z(angle) @ light turns it."""
    identity = torch.eye(L_COUNT, dtype=angle.dtype, device=angle.device)
    return rotate_z(identity.expand(len(angle), -1, -1), angle[:, None]).mT
