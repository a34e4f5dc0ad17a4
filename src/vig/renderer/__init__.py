"""The differentiable renderer, `vig_renderer`, and explanations drawn by it: tensors of torch."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from vig.renderer.explained import render_latents as render_latents
    from vig.renderer.explained import scene_of as scene_of
    from vig_renderer import DirectionalLight as DirectionalLight
    from vig_renderer import MeshObject as MeshObject
    from vig_renderer import Pinhole as Pinhole
    from vig_renderer import Pyramid as Pyramid
    from vig_renderer import Rendering as Rendering
    from vig_renderer import Scene as Scene
    from vig_renderer import Topology as Topology
    from vig_renderer import jacobian as jacobian
    from vig_renderer import pyramid as pyramid
    from vig_renderer import render as render

_OWN = ("render_latents", "scene_of")

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


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module 'vig.renderer' has no attribute '{name}'")
    renderer = import_module("vig_renderer")
    _ = renderer.render  # which says what to install where torch is missing
    return getattr(import_module("vig.renderer.explained") if name in _OWN else renderer, name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
