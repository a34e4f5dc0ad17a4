"""The differentiable renderer, `vig_renderer`, and explanations drawn by it: tensors of torch."""

from importlib import import_module
from typing import Any

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
    _ = renderer.render  # which states the package to install where torch is missing
    own = name in ("render_latents", "scene_of")
    return getattr(import_module("vig.renderer.explained") if own else renderer, name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
