"""Several objects in one photo, explained together."""

from vig.together.explain import MOST_OBJECTS, explain_found, explain_together, find_together
from vig.together.joint import order, together
from vig.together.scene import SceneExplanation

__all__ = [
    "MOST_OBJECTS",
    "SceneExplanation",
    "explain_found",
    "explain_together",
    "find_together",
    "order",
    "together",
]
