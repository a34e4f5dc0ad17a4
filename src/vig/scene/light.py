"""Light as nine real spherical-harmonic (SH) coefficients, and colour.

Coefficients are of incident radiance in the orthonormal real basis, in the order (l, m) =
(0,0), (1,-1), (1,0), (1,1), (2,-2), ..., (2,2), in the world frame (Z up); `vig_renderer.harmonics` has the
basis and the light that a surface reflects.
"""

import math

import numpy as np

from vig_renderer.arrays import Array, floating, like, namespace
from vig_renderer.harmonics import COSINE_LOBE as COSINE_LOBE
from vig_renderer.harmonics import L_COUNT as L_COUNT
from vig_renderer.harmonics import Y00 as Y00
from vig_renderer.harmonics import Y1 as Y1
from vig_renderer.harmonics import Y2 as Y2
from vig_renderer.harmonics import Y20 as Y20
from vig_renderer.harmonics import sh_basis as sh_basis


def linear_from_srgb(srgb: Array) -> Array:
    """Decode sRGB values in [0, 1] to linear light in [0, 1], elementwise."""
    srgb = floating(srgb)
    return namespace(srgb).where(
        srgb <= 0.04045, srgb / 12.92, ((srgb.clip(0.0, None) + 0.055) / 1.055) ** 2.4
    )


def srgb_from_linear(linear: Array) -> Array:
    """Encode linear light in [0, 1] as sRGB in [0, 1], elementwise; values outside are clipped."""
    linear = floating(linear)
    clipped = linear.clip(0.0, 1.0)
    # Not of 0, where the slope of a root has no end.
    root = clipped.clip(1e-12, None) ** (1 / 2.4)
    return namespace(linear).where(clipped <= 0.0031308, clipped * 12.92, 1.055 * root - 0.055)


def srgb8_from_linear(linear: np.ndarray) -> np.ndarray:
    """Encode linear light in [0, 1] as 8-bit sRGB: any shape, uint8."""
    coded: np.ndarray = np.round(srgb_from_linear(np.asarray(linear)) * 255).astype(np.uint8)
    return coded


EXPOSURE_L00 = 0.75 * math.pi
"""L00 of every light after exposure: the paper's 0.75 in its units, which lack the 1 / pi."""


def irradiance(light: Array, normals: Array) -> Array:
    """Return the light that a white Lambertian surface reflects (irradiance / pi, Eq. 1 with SH light).

    light: (..., 9); normals: (..., 3) unit, broadcast against light's leading axes. Result >= 0.
    """
    light = floating(light)
    return ((light * like(light, COSINE_LOBE)) * sh_basis(normals)).sum(-1).clip(0.0, None)


def rotate_z(light: Array, angle: Array | float) -> Array:
    """Return light turned by `angle` radians about +Z, counter-clockwise: (..., 9), angle (...) or a number.

    The turned light in direction d is the given light in direction Rz(-angle) d.
    """
    light = floating(light)
    functions, angle = namespace(light), like(light, angle)
    c1, s1, c2, s2 = (of(times * angle) for times in (1, 2) for of in (functions.cos, functions.sin))
    l00, y, z, x, xy, yz, zz, xz, x2y2 = (light[..., number] for number in range(L_COUNT))
    turned = [
        l00 + 0 * c1,
        c1 * y + s1 * x,
        z + 0 * c1,
        c1 * x - s1 * y,
        c2 * xy + s2 * x2y2,
        c1 * yz + s1 * xz,
        zz + 0 * c1,
        c1 * xz - s1 * yz,
        c2 * x2y2 - s2 * xy,
    ]
    return functions.stack(turned, axis=-1)


def rotations_z(angle: Array) -> Array:
    """Return matrices of `rotate_z`: (B,) radians to (B, 9, 9); rotations_z(angle) @ light turns it."""
    angle = floating(angle)
    identity = like(angle, np.eye(L_COUNT))[None]
    return rotate_z(identity, angle[:, None]).swapaxes(-1, -2)
