"""Device functions of the pixel likelihood: Eq. 3 at a pixel, and the row that a pixel's colour gives."""

import functools
import math
from types import SimpleNamespace

import torch
import warp as wp

from vig.render.surface import surface_functions


@functools.cache
def likelihood_functions(dtype: torch.dtype, modes: int) -> SimpleNamespace:
    """The surface's device functions and the likelihood's, for one scalar type and number of components."""
    f = surface_functions(dtype, modes)
    real, vec2, vec3, row_type = f.real, f.vec2, f.vec3, f.row_type
    gradient_at = f.layout.used
    log_unit = real(3.0 * math.log(math.sqrt(2.0 * math.pi)))

    @wp.func
    def explained(observed: vec3, rendered: vec3, log_prior: vec3, sigma: real):
        """(log-likelihood of a covered pixel, posterior of its being visible), Eq. 3."""
        error = observed - rendered
        inlier = (
            log_prior[0]
            - wp.dot(error, error) / (real(2.0) * sigma * sigma)
            - real(3.0) * wp.log(sigma)
            - log_unit
        )
        gap = inlier - log_prior[1]
        if gap > real(0.0):
            ratio = wp.exp(-gap)
            return vec2(inlier + wp.log(real(1.0) + ratio), real(1.0) / (real(1.0) + ratio))
        ratio = wp.exp(gap)
        return vec2(log_prior[1] + wp.log(real(1.0) + ratio), ratio / (real(1.0) + ratio))

    @wp.func
    def emit_colour(
        slot: int,
        image: int,
        row: row_type,
        weight: real,
        irradiance: real,
        observed: vec3,
        albedo: vec3,
        rows: wp.array2d(dtype=row_type),
        weighted: wp.array2d(dtype=row_type),
    ):
        """A row of irradiance: weight is the posterior over sigma squared, times signed coverage."""
        error = observed - albedo * irradiance
        scaled = row * wp.abs(weight)
        scaled[gradient_at] = weight * wp.dot(albedo, error)
        scaled[gradient_at + 1] = weight * error[0]
        scaled[gradient_at + 2] = weight * error[1]
        scaled[gradient_at + 3] = weight * error[2]
        if slot < rows.shape[1]:
            rows[image, slot] = row
            weighted[image, slot] = scaled

    return SimpleNamespace(explained=explained, emit_colour=emit_colour, **vars(f))
