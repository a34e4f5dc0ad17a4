"""A panorama's light at a place on a support: nine grey SH coefficients, and what a mirror shows there."""

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from vig.scene.light import EXPOSURE_L00, Y00, Y1, sh_basis

Array = np.ndarray


def light_parts(radiance: Array) -> NDArray[np.float64]:
    """Compute a panorama's light on a level support: (2, 9) grey SH of radiance, unexposed.

    First of the panorama's upper hemisphere alone, then of the light reflected by a white support that fills
    the lower one: everywhere E / pi, E being the irradiance from above. Both turn with `rotate_z`, so they
    are computed once per panorama.

    Args:
        radiance: (H, W, 3), H even.
    """
    rows = len(radiance)
    if rows % 2:
        raise ValueError(f"a panorama needs an even number of rows to be cut at its horizon; got {rows}.")
    above = np.array(radiance)
    above[rows // 2 :] = 0
    upper = grey(project_panorama(above))
    # Row by row the integral of cosine over solid angle, and over all directions below of Y00 and Y10.
    sine = np.sin(np.linspace(0, np.pi / 2, rows // 2 + 1))
    cosines = np.pi * (sine[1:] ** 2 - sine[:-1] ** 2)
    reflected = cosines @ grey(above[: rows // 2].mean(axis=1, dtype=np.float64)) / np.pi
    white = np.zeros(9)
    white[0], white[2] = 2 * np.pi * Y00 * reflected, -np.pi * Y1 * reflected
    return np.stack([upper, white])


def local_light(radiance: Array, ground_albedo: float) -> NDArray[np.float64]:
    """Return grey light (9,) at a place on a level support of this albedo, at the paper's exposure.

    Args:
        radiance: (H, W, 3), H even, or its `light_parts` (2, 9).
        ground_albedo: Grey albedo of the support, which hides the lower hemisphere and reflects
            albedo x E / pi, E being the irradiance from above.

    Returns:
        (9,); turning it by `rotate_z` is the same as turning the panorama.

    Raises:
        ValueError: When no light comes from above.
    """
    upper, white = radiance if radiance.shape == (2, 9) else light_parts(radiance)
    return expose_light(upper + ground_albedo * white)


def directions(height: int, width: int) -> Array:
    """Return unit directions (H, W, 3) of a panorama's pixels.

    Row 0 is straight up (+Z), column u at azimuth 2 pi (u + 0.5) / W counter-clockwise from +X.
    """
    theta = ((np.arange(height) + 0.5) * math.pi / height)[:, None]
    phi = (np.arange(width) + 0.5) * 2 * math.pi / width
    xyz = np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)
    return np.stack(np.broadcast_arrays(*xyz), axis=-1)


def project_panorama(radiance: np.ndarray) -> np.ndarray:
    """Return SH coefficients of an equirectangular panorama, per channel.

    radiance: (H, W, 3) linear, in `directions`. Result (9, 3) float64. Exact solid angle per row.
    """
    if radiance.ndim != 3 or radiance.shape[2] != 3:
        raise ValueError(f"a panorama must be (H, W, 3) linear radiance; got {radiance.shape}")
    height, width = radiance.shape[:2]
    edges = np.cos(np.linspace(0.0, math.pi, height + 1))
    solid_angle = (edges[:-1] - edges[1:]) * (2 * math.pi / width)
    basis = sh_basis(directions(height, width))
    return np.einsum("hwl,hwc,h->lc", basis, radiance.astype(np.float64), solid_angle, optimize=True)


def grey(light_rgb: np.ndarray) -> np.ndarray:
    """Return luminance (Rec. 709) of RGB light coefficients: (..., 3) to (...)."""
    return np.asarray(light_rgb) @ np.array([0.2126, 0.7152, 0.0722])


def expose_light(light: np.ndarray) -> np.ndarray:
    """Return a grey light scaled so that its L00 is the exposure of the paper: (9,) to (9,)."""
    if not light[0] > 0:
        raise ValueError(f"a light needs a positive mean radiance to be exposed; L00 is {light[0]}")
    return light * (EXPOSURE_L00 / light[0])


def mirror(
    radiance: np.ndarray, angle: float, ground_albedo: float
) -> Callable[[np.ndarray, float], np.ndarray]:
    """Return the radiance from unit directions (N, 3), as a rough mirror shows it, above a level ground.

    Args:
        radiance: (H, 2H, 3) equirectangular, as in `project_panorama`.
        angle: Radians by which it is turned about +Z.
        ground_albedo: Albedo (3,) of the ground below, lit by the panorama's mean.
    """
    height, width = radiance.shape[:2]
    below = ground_albedo * radiance[: height // 2].mean((0, 1))

    def from_directions(directions: np.ndarray, roughness: float) -> np.ndarray:
        # A lobe's width is about twice the roughness squared, in radians.
        blur = 2 * max(roughness, 0.01) ** 2 * height / np.pi
        soft = radiance
        if blur > 0.5:
            soft = ndimage.gaussian_filter(radiance, (blur, blur, 0), mode=("nearest", "wrap", "nearest"))
        around = (np.arctan2(directions[:, 1], directions[:, 0]) - angle) / (2 * np.pi)
        down = np.arccos(np.clip(directions[:, 2], -1, 1)) / np.pi
        row = np.minimum((down * height).astype(np.int32), height - 1)
        place = row * width + np.floor(around * width).astype(np.int32) % width
        reflected = soft.reshape(-1, 3).T.take(place, axis=1)  # a channel after the other: faster
        return np.where(directions[:, 2] < 0, below[:, None], reflected).T

    return from_directions
