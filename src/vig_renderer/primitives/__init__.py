"""The primitives of the differentiable renderer: pure functions on tensors, out of which `render` is made."""

from vig_renderer.primitives.crossings import Crossings, find_crossings
from vig_renderer.primitives.interpolate import antialias, barycentrics, interpolate
from vig_renderer.primitives.texture import Pyramid, pyramid, sample_texture, stack_pyramids
from vig_renderer.primitives.topology import Topology
from vig_renderer.primitives.visibility import Visible, visible_faces

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
