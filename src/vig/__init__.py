"""vig: vision as inverse graphics. Explains one object in one photo, even where it is hidden.

import vig

explanation = vig.Explainer("teapot").explain("photo.jpg", box=(120, 80, 300, 240))
explanation.save("result")
"""

from importlib import import_module
from typing import Any

__version__ = "0.3.0.dev0"

_HOMES = {
    "Camera": "vig.scene",
    "Explainer": "vig.explainer",
    "Explanation": "vig.explanation",
    "Hints": "vig.hints",
    "Latents": "vig.scene",
    "ObjectClass": "vig.scene",
    "Track": "vig.video",
    "TrackedFrame": "vig.video",
    "TrackedPose": "vig.video",
    "Tracker": "vig.video",
    "UserError": "vig.io.errors",
    "Verdict": "vig.inference",
    "SceneExplanation": "vig.several",
    "explain_found": "vig.several",
    "explain_together": "vig.several",
    "render": "vig_renderer",
    "track": "vig.video",
}
"""Package of each public name: imported on first use, so that `import vig` is quick. Type
checkers read `__init__.pyi`."""

__all__ = ["__version__", *_HOMES]


def __getattr__(name: str) -> Any:
    if name == "renderer":
        return import_module("vig.renderer")
    if name not in _HOMES:
        raise AttributeError(f"module 'vig' has no attribute '{name}'")
    return getattr(import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
