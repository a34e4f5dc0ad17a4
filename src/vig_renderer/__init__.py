"""The differentiable renderer: rasterisation, shading, coverage, Jacobians. It needs nothing else of vig."""

from importlib import import_module
from typing import Any

_HOMES = {
    "DirectionalLight": "scene",
    "MeshObject": "scene",
    "Pinhole": "scene",
    "Pyramid": "texture",
    "Rendering": "scene",
    "Scene": "scene",
    "Topology": "topology",
    "jacobian": "rendering",
    "pyramid": "texture",
    "render": "rendering",
}
"""Module of each public name: imported on first use, as torch takes a second."""

NEAR = 0.01  # metres along the optical axis; nothing nearer is drawn by default

__all__ = ["NEAR", *_HOMES]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'vig_renderer' has no attribute '{name}'")
    try:
        home = import_module(f"vig_renderer.{_HOMES[name]}")
    except ModuleNotFoundError as error:
        if error.name != "torch":
            raise
        why = "expected torch, for the differentiable renderer; it is not installed. pip install 'vig[torch]'"
        raise ModuleNotFoundError(why, name="torch") from None
    return getattr(home, name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
