"""Eq. 3 at one pixel: the log-likelihood of a covered pixel, and the posterior of its being visible."""

import math

import torch
import warp as wp

from vig.likelihood import densities
from vig_renderer.device import native_code

snippet = native_code(densities.FOLDER, f"{density}.cc", real=real)
log_unit = real(densities.density_of(density).LOG_UNIT)
# Beyond it the less likely of two components is lost in rounding.
clear = real(-math.log(torch.finfo(dtype).eps))


@wp.func_native(snippet=snippet + "return LOG_DENSITY(s);")
def log_density(s: real) -> real: ...


@wp.func_native(snippet=snippet + "return PULL(s);")
def pull(s: real) -> real: ...


@wp.struct
class Noise:
    """The density of a visible pixel: one over twice its variance, and its log normaliser."""

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
    inlier = log_prior[0] + noise.log_normaliser + log_density(wp.dot(error, error) * noise.half_precision)
    # Log odds of visible against hidden.
    gap = inlier - log_prior[1]
    if gap > clear:
        return vec2(inlier, real(1.0))
    if gap < -clear:
        return vec2(log_prior[1], real(0.0))
    # log(exp(a) + exp(b)) = max + log(1 + exp(-|a - b|)), so that nothing overflows.
    ratio = wp.exp(-wp.abs(gap))
    share = real(1.0) / (real(1.0) + ratio)
    if gap < real(0.0):
        share = ratio * share
    return vec2(wp.max(inlier, log_prior[1]) + wp.log(real(1.0) + ratio), share)
