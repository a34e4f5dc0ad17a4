"""The differentiable renderer: rasterisation, shading, coverage, Jacobians."""

from vig.render.device import warp_array
from vig.render.jacobian import jacobian
from vig.render.primitives import pyramid
from vig.render.primitives.pyramid import Pyramid
from vig.render.primitives.topology import Topology
from vig.render.raster import NOTHING, Fragments, raster_kernels, rasterize
from vig.render.rendering import render
from vig.render.scene import DirectionalLight, MeshObject, Pinhole, Rendering, Scene

__all__ = [
    "NOTHING",
    "DirectionalLight",
    "Fragments",
    "MeshObject",
    "Pinhole",
    "Pyramid",
    "Rendering",
    "Scene",
    "Topology",
    "jacobian",
    "pyramid",
    "raster_kernels",
    "rasterize",
    "render",
    "warp_array",
]
