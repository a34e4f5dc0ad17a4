"""The differentiable renderer: rasterisation, shading, coverage, Jacobians."""

from vig.render.device import warp_array
from vig.render.geometry import Geometry
from vig.render.raster import NOTHING, Fragments, raster_kernels, rasterize
from vig.render.threads import map_on_threads, run_on_threads

__all__ = [
    "NOTHING",
    "Fragments",
    "Geometry",
    "map_on_threads",
    "raster_kernels",
    "rasterize",
    "run_on_threads",
    "warp_array",
]
