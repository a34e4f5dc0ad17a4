"""The differentiable renderer: rasterisation, shading, coverage, Jacobians."""

from vig.renderer.device import warp_array
from vig.renderer.explained import render_latents, scene_of
from vig.renderer.primitives.texture import Pyramid, pyramid
from vig.renderer.primitives.topology import Topology
from vig.renderer.raster import NOTHING
from vig.renderer.rendering import jacobian, render
from vig.renderer.scene import DirectionalLight, MeshObject, Pinhole, Rendering, Scene

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
    "render_latents",
    "scene_of",
    "warp_array",
]
