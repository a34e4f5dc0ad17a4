"""The differentiable renderer: rasterisation, shading, coverage, Jacobians. It needs nothing else of vig."""

from vig_renderer.device import warp_array
from vig_renderer.primitives.texture import Pyramid, pyramid
from vig_renderer.primitives.topology import Topology
from vig_renderer.raster import NOTHING
from vig_renderer.rendering import jacobian, render
from vig_renderer.scene import DirectionalLight, MeshObject, Pinhole, Rendering, Scene

__all__ = [
    "NOTHING",
    "DirectionalLight",
    "MeshObject",
    "Pinhole",
    "Pyramid",
    "Rendering",
    "Scene",
    "Topology",
    "jacobian",
    "pyramid",
    "render",
    "warp_array",
]
