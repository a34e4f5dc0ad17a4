"""The differentiable renderer: rasterisation, shading, coverage, Jacobians."""

from vig.render.device import warp_array
from vig.render.geometry import Geometry, VertexState, shade_vertices
from vig.render.raster import NOTHING, Fragments, raster_kernels, rasterize

__all__ = [
    "NOTHING",
    "Fragments",
    "Geometry",
    "VertexState",
    "raster_kernels",
    "rasterize",
    "shade_vertices",
    "warp_array",
]
