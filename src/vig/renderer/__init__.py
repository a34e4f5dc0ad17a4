"""The differentiable renderer, `vig_renderer`, and explanations drawn by it."""

from vig.renderer.explained import render_latents, scene_of
from vig_renderer import (
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
)

__all__ = [
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
]
