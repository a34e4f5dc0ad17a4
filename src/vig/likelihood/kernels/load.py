"""The kernels of one evaluation of Eq. 4 for one scalar type and number of shape components.

Their code stands in `templates/`: plain functions of Warp, whose types are named `real`, `vec3`, ...
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import torch
import warp as wp

from vig.likelihood.kernels.layout import RowLayout
from vig.scene.light import L_COUNT
from vig_renderer.device import instantiate, kernel_module, vector_types
from vig_renderer.once import make_once
from vig_renderer.raster import rasterize_kernel

TEMPLATES = (
    *("arguments", "camera", "rows", "surface", "density", "edges", "blending"),
    *("vertices", "interior", "boundary", "assembly"),
)
"""In the order in which they are executed: each may use what those before it define."""

STRUCTS = (
    *("mesh", "view", "vertices", "vertex_rows", "lighting", "photos", "cotangents", "totals"),
    *("normal_rows", "pictures", "occluding"),
)
"""Arguments of kernels that are structs: `vertex_rows` is a `VertexRows` of arguments.py."""

PARTS = 32
"""Pieces into which an image's vertices, faces, lines of pixels and edges are cut on a processor."""
CUDA_PARTS = 256
"""And on a GPU, one thread each."""


@make_once
def likelihood_kernels(dtype: torch.dtype, modes: int, density: str) -> Any:
    """A module with all kernels, types and structs; kernels are compiled at first use.

    density: see `vig.likelihood.densities`.

    One module of Warp holds them all, as most of the time of compiling goes into Warp's own headers.
    """
    rows = RowLayout(modes)
    types = vector_types(dtype)
    real = types["real"]
    module = kernel_module(f"fit{modes}_{density}", dtype)
    kernels = instantiate(
        [Path(__file__).parent / "templates" / f"{name}.py" for name in TEMPLATES],
        module,
        dtype=dtype,
        modes=modes,
        density=density,
        shape_row=wp.types.vector(rows.shape, real),
        rest_row=wp.types.vector(rows.rest, real),
        lobe_vector=wp.types.vector(L_COUNT, real),
        **types,
    )
    kernels.rasterize_faces = rasterize_kernel(dtype, module)
    kernels.structs = {name: getattr(kernels, name.title().replace("_", "")) for name in STRUCTS}
    return kernels


@make_once
def load_kernels(dtype: torch.dtype, modes: int, device: str = "cpu", density: str = "gaussian") -> None:
    """Compile or load all kernels of a fit, once."""
    wp.force_load(device, modules=[likelihood_kernels(dtype, modes, density).place.module])
