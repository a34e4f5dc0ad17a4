"""Several objects in one photo, explained together."""

from vig.several.explain import MOST_OBJECTS, explain_found, explain_together, find_together
from vig.several.joint import fit_jointly, order
from vig.several.scene import SceneExplanation

__all__ = [
    "MOST_OBJECTS",
    "SceneExplanation",
    "explain_found",
    "explain_together",
    "find_together",
    "fit_jointly",
    "order",
]
