"""Kernels of Eq. 4: those of the object's interior here, those of its occlusion edges from `boundary`."""

import functools
from types import SimpleNamespace

import torch
import warp as wp

from vig.likelihood.boundary import boundary_kernels
from vig.likelihood.functions import likelihood_functions
from vig.render.geometry import module_name, vertex_kernels
from vig.render.raster import raster_kernels

NEGLIGIBLE = 1e-9
"""Posterior of being visible below which a pixel moves nothing: most of what is hidden."""


@functools.cache
def likelihood_kernels(dtype: torch.dtype, modes: int) -> SimpleNamespace:
    """The likelihood's kernels, all in one module, for one scalar type and number of shape components."""
    f = likelihood_functions(dtype, modes)
    real, vec2, vec3, mat33, row_type = f.real, f.vec2, f.vec3, f.mat33, f.row_type
    view_of, hit_of, hit_row = f.view_of, f.hit_of, f.hit_row
    explained, emit_colour = f.explained, f.emit_colour
    negligible = real(NEGLIGIBLE)
    module = module_name("likelihood", dtype, modes)

    @wp.kernel(module=module)
    def interior(
        points: wp.array2d(dtype=vec3),
        attributes: wp.array2d(dtype=row_type),
        irradiances: wp.array2d(dtype=real),
        basis: wp.array2d(dtype=row_type),
        faces: wp.array2d(dtype=wp.int32),
        width: wp.int32,
        rotation: wp.array(dtype=mat33),
        intrinsics: wp.array(dtype=vec3),
        distance: real,
        albedo: wp.array(dtype=vec3),
        keys: wp.array2d(dtype=wp.int64),
        observed: wp.array2d(dtype=vec3),
        log_prior: wp.array2d(dtype=vec3),
        photo: wp.array(dtype=wp.int32),
        sigma: wp.array(dtype=real),
        differentiate: wp.int32,
        keep: wp.array2d(dtype=real),
        extra: wp.array2d(dtype=real),
        covered: wp.array2d(dtype=wp.int64),
        log_likelihood: wp.array2d(dtype=real),
        posterior: wp.array2d(dtype=real),
        irradiance: wp.array2d(dtype=real),
        used: wp.array(dtype=wp.int32),
        rows: wp.array2d(dtype=row_type),
        weighted: wp.array2d(dtype=row_type),
    ):
        index = wp.tid()
        image = int(covered[index, 0])
        at = int(covered[index, 1])
        y = at / width
        x = at - y * width
        which = photo[image]
        key = keys[image, at]
        share = keep[image, at]
        view = view_of(rotation[image], distance, intrinsics[image], width)
        pixel = vec2(real(x) + real(0.5), real(y) + real(0.5))
        hit = hit_of(view, image, int(key & wp.int64(0xFFFFFFFF)), pixel, points, irradiances, faces)
        seen = observed[which, at]
        colour = albedo[image]
        s = sigma[image]
        fit = explained(seen, colour * hit.irradiance, log_prior[which, at], s)
        log_likelihood[image, at] = share * fit[0] + extra[image, at]
        posterior[image, at] = fit[1]
        irradiance[image, at] = hit.irradiance
        weight = share * fit[1] / (s * s)
        if differentiate == 0 or fit[1] < negligible:
            return
        slot = wp.atomic_add(used, image, 1)
        emit_colour(
            slot,
            image,
            hit_row(view, image, hit, pixel, attributes, basis),
            weight,
            hit.irradiance,
            seen,
            colour,
            rows,
            weighted,
        )

    return SimpleNamespace(interior=interior, **vars(boundary_kernels(dtype, modes)), **vars(f))


def load_kernels(dtype: torch.dtype, modes: int, device: str = "cpu") -> None:
    """Compile or load all kernels of a fit at once, two modules side by side; else each does at first use."""
    first = vertex_kernels(dtype, modes).shade_vertices, raster_kernels(dtype).rasterize_faces
    kernels = (*first, likelihood_kernels(dtype, modes).interior)
    wp.force_load(device, modules=[kernel.module for kernel in kernels], max_workers=2)
