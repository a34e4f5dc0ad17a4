"""Device functions of the pixel likelihood: Eq. 3 at one pixel."""

import functools
import math
from types import SimpleNamespace

import torch
import warp as wp

from vig.likelihood.kernels.groups import kernel_types
from vig.likelihood.pixel import LOG_UNIT


@functools.cache
def pixel_functions(dtype: torch.dtype, modes: int) -> SimpleNamespace:
    """The device functions for one scalar type and number of shape components."""
    t = kernel_types(dtype, modes)
    real, vec2, vec3 = t.real, t.vec2, t.vec3
    log_unit = real(LOG_UNIT)
    # Beyond it the less likely of two components is lost in rounding.
    clear = real(-math.log(torch.finfo(dtype).eps))

    @wp.struct
    class Noise:
        """The Gaussian of a covered pixel: one over twice its variance, and its log normaliser."""

        half_precision: real
        log_normaliser: real

    @wp.func
    def noise_of(sigma: real):
        noise = Noise()
        noise.half_precision = real(0.5) / (sigma * sigma)
        noise.log_normaliser = real(-3.0) * wp.log(sigma) - log_unit
        return noise

    @wp.func
    def explained(observed: vec3, rendered: vec3, log_prior: vec3, noise: Noise):
        """(log-likelihood of a covered pixel, posterior of its being visible), Eq. 3."""
        error = observed - rendered
        inlier = log_prior[0] + noise.log_normaliser - wp.dot(error, error) * noise.half_precision
        gap = inlier - log_prior[1]
        if gap > clear:
            return vec2(inlier, real(1.0))
        if gap < -clear:
            return vec2(log_prior[1], real(0.0))
        ratio = wp.exp(-wp.abs(gap))
        share = real(1.0) / (real(1.0) + ratio)
        if gap < real(0.0):
            share = ratio * share
        return vec2(wp.max(inlier, log_prior[1]) + wp.log(real(1.0) + ratio), share)

    return SimpleNamespace(Noise=Noise, noise_of=noise_of, explained=explained)
