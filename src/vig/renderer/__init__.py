"""The differentiable renderer, `vig_renderer`, and explanations drawn by it."""

from vig.renderer.explained import render_latents, scene_of
from vig_renderer import (
    NOTHING,
    DirectionalLight,
    MeshObject,
    Pinhole,
    Pyramid,
    Rendering,
    Scene,
    Topology,
    jacobian,
    pyramid,
    render,
    warp_array,
)

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
