"""vig: vision as inverse graphics. Explains one object in one photo, even where it is hidden.

import vig

explanation = vig.Explainer("teapot").explain("photo.jpg", box=(120, 80, 300, 240))
explanation.save("result")
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from vig.explainer import Explainer as Explainer
    from vig.explanation import Explanation as Explanation
    from vig.hints import Hints as Hints
    from vig.inference.settings import Verdict as Verdict
    from vig.io.errors import UserError as UserError
    from vig.scene.camera import Camera as Camera
    from vig.scene.latents import Latents as Latents
    from vig.scene.object_class import ObjectClass as ObjectClass
    from vig.several import SceneExplanation as SceneExplanation
    from vig.several import explain_found as explain_found
    from vig.several import explain_together as explain_together
    from vig.video import Track as Track
    from vig.video import TrackedFrame as TrackedFrame
    from vig.video import TrackedPose as TrackedPose
    from vig.video import Tracker as Tracker
    from vig.video import track as track
    from vig_renderer.rendering import render as render

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
"""Where each public name lives: imported when it is first asked for, so that `import vig` is quick."""

__all__ = ["__version__", *_HOMES]


def __getattr__(name: str) -> Any:
    if name == "renderer":
        return import_module("vig.renderer")
    if name not in _HOMES:
        raise AttributeError(f"module 'vig' has no attribute '{name}'")
    return getattr(import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
