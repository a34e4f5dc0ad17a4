"""The differentiable renderer: rasterisation, shading, coverage, Jacobians."""

from vig.render.device import warp_array
from vig.render.geometry import Geometry, VertexState, shade_vertices
from vig.render.jacobian import jacobian
from vig.render.primitives import Pyramid, Topology, pyramid
from vig.render.raster import NOTHING, Fragments, raster_kernels, rasterize
from vig.render.rendering import render
from vig.render.scene import DirectionalLight, MeshObject, Pinhole, Rendering, Scene

__all__ = [
    "NOTHING",
    "DirectionalLight",
    "Fragments",
    "Geometry",
    "MeshObject",
    "Pinhole",
    "Pyramid",
    "Rendering",
    "Scene",
    "Topology",
    "VertexState",
    "jacobian",
    "pyramid",
    "raster_kernels",
    "rasterize",
    "render",
    "shade_vertices",
    "warp_array",
]
