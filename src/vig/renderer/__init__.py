"""The differentiable renderer: rasterisation, shading, coverage, Jacobians."""

from vig.renderer.device import warp_array
from vig.renderer.explained import render_latents, scene_of
from vig.renderer.primitives.texture import Pyramid, pyramid
from vig.renderer.primitives.topology import Topology
from vig.renderer.raster import NOTHING, Fragments, raster_kernels, rasterize
from vig.renderer.rendering import jacobian, render
from vig.renderer.scene import DirectionalLight, MeshObject, Pinhole, Rendering, Scene

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
    "render_latents",
    "scene_of",
    "warp_array",
]
