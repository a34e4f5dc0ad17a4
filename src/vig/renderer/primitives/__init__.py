"""The primitives of the differentiable renderer: pure functions on tensors, out of which `render` is made."""

from vig.renderer.primitives.antialias import antialias
from vig.renderer.primitives.crossings import Crossings, find_crossings
from vig.renderer.primitives.interpolate import barycentrics, interpolate
from vig.renderer.primitives.pyramid import Pyramid, pyramid, stack_pyramids
from vig.renderer.primitives.texture import sample_texture
from vig.renderer.primitives.topology import Topology
from vig.renderer.primitives.visibility import Visible, visible_faces

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
