"""Several objects in one photo, explained together."""

from vig.several.explain import MAX_OBJECTS as MAX_OBJECTS
from vig.several.explain import explain_found as explain_found
from vig.several.explain import explain_together as explain_together
from vig.several.explain import find_together as find_together
from vig.several.joint import fit_jointly as fit_jointly
from vig.several.joint import order as order
from vig.several.scene import SceneExplanation as SceneExplanation
