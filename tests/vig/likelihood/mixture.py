"""Eq. 3 in plain numpy, to which native code is compared."""

import math

import numpy as np

from vig_native import engine

LOG_DENSITIES = {"gaussian": lambda s: -s}
"""The densities of vig_native/densities: log_density(s), see density.h."""


def mixture(
    observed: np.ndarray, rendered: np.ndarray, log_prior: np.ndarray, sigma: float, density: str = "gaussian"
) -> tuple[np.ndarray, np.ndarray]:
    """Log-likelihood of pixels that the object covers and the posterior of their being visible (Eq. 3).

    observed, rendered: (..., 3) linear RGB. log_prior: (..., 3) as `PixelModel.log_prior`. Both results
    (...).
    """
    s = ((observed - rendered) ** 2).sum(-1) / (2 * sigma**2)
    # Three channels: the normaliser of the Gaussian is -3 log(sigma).
    inlier = log_prior[..., 0] + LOG_DENSITIES[density](s) - 3 * math.log(sigma)
    inlier = inlier - engine.DENSITIES[density]
    both = np.logaddexp(inlier, log_prior[..., 1])
    return both, np.exp(inlier - both)
