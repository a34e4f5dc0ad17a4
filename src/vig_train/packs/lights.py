"""The prior of light that falls on things indoors, from the training panoramas: the same for all classes."""

from __future__ import annotations

import numpy as np

from vig.scene import EXPOSURE_L00, ObjectClass
from vig_world.library import Library

TURN_COUNT = 12
"""Turns of each panorama about the vertical."""
GROUND_ALBEDOS = (0.1, 0.25, 0.5)
"""Albedos of the object's support."""


def light_prior() -> tuple[np.ndarray, np.ndarray]:
    """Return mean (9,) and covariance (9, 9) of spherical harmonics in the world frame, at the paper's
    exposure.
    """
    angles = 2 * np.pi * np.arange(TURN_COUNT) / TURN_COUNT
    library = Library("train")
    lights = np.array(
        [library.light(i, a, g) for i in range(library.panoramas) for a in angles for g in GROUND_ALBEDOS]
    )
    covariance = np.cov(lights.T)
    # L00 is uncertain by 5 %, so that an exposure slightly off can be explained.
    covariance[0, 0] += (0.05 * EXPOSURE_L00) ** 2
    return lights.mean(0), covariance


def packaged_light_prior() -> tuple[np.ndarray, np.ndarray]:
    """Return `light_prior` as the packaged classes have it, for which no panorama has to be made."""
    packaged = ObjectClass.load("teapot")
    return packaged.light_prior_mean, packaged.light_prior_covariance
