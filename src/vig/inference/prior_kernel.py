"""The kernel of a prior's value and derivatives."""

from pathlib import Path
from typing import Any

import torch
import warp as wp

from vig.search.damped_step import search_kernels
from vig_renderer.device import initialise, kernel_module, native_code, scalar_type
from vig_renderer.once import make_once


@make_once
def prior_kernel(dtype: torch.dtype) -> Any:
    """The kernel for one scalar type; a thread for each point. Empty Gaussians of the heading frame, or no
    azimuths, add nothing."""
    initialise()
    real = scalar_type(dtype)

    @wp.func_native(snippet=native_code(Path(__file__).parent, "prior.cc", real=real))
    def add_one(
        point: wp.int32,
        points: wp.array2d(dtype=real),
        mean: wp.array(dtype=real),
        precision: wp.array2d(dtype=real),
        heading_mean: wp.array(dtype=real),
        heading_precision: wp.array(dtype=real),
        azimuths: wp.array(dtype=real),
        azimuth_precision: real,
        fold: real,
        azimuth: wp.int32,
        light: wp.int32,
        value: wp.array(dtype=wp.float64),
        gradient: wp.array2d(dtype=real),
        normal: wp.array3d(dtype=real),
    ): ...

    @wp.kernel(module=kernel_module("search", dtype))
    def add(
        points: wp.array2d(dtype=real),
        mean: wp.array(dtype=real),
        precision: wp.array2d(dtype=real),
        heading_mean: wp.array(dtype=real),
        heading_precision: wp.array(dtype=real),
        azimuths: wp.array(dtype=real),
        azimuth_precision: real,
        fold: real,
        azimuth: wp.int32,
        light: wp.int32,
        value: wp.array(dtype=wp.float64),
        gradient: wp.array2d(dtype=real),
        normal: wp.array3d(dtype=real),
    ):
        add_one(
            wp.tid(),
            points,
            mean,
            precision,
            heading_mean,
            heading_precision,
            azimuths,
            azimuth_precision,
            fold,
            azimuth,
            light,
            value,
            gradient,
            normal,
        )

    return add


@make_once
def load_search_kernels(dtype: torch.dtype, device: str) -> None:
    """Make and load the kernels of priors and searches, one module."""
    search_kernels(dtype)
    wp.force_load(device, modules=[prior_kernel(dtype).module])
