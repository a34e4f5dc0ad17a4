"""The primitives of the differentiable renderer: pure functions on tensors, out of which `render` is made."""

from vig.render.primitives.antialias import antialias
from vig.render.primitives.barycentrics import barycentrics
from vig.render.primitives.crossings import Crossings, find_crossings
from vig.render.primitives.interpolate import interpolate
from vig.render.primitives.pyramid import Pyramid, pyramid, stack_pyramids
from vig.render.primitives.texture import sample_texture
from vig.render.primitives.topology import Topology
from vig.render.primitives.visibility import Visible, visible_faces

__all__ = [
    "Crossings",
    "Pyramid",
    "Topology",
    "Visible",
    "antialias",
    "barycentrics",
    "find_crossings",
    "interpolate",
    "pyramid",
    "sample_texture",
    "stack_pyramids",
    "visible_faces",
]
