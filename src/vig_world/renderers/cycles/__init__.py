"""The path-traced tier: the scenes of `vig_world` by Blender's Cycles, in processes of its own."""

from vig_world.renderers.cycles.appearance import FINISHES, Finish
from vig_world.renderers.cycles.renderer import CyclesRenderer, TracedPicture

__all__ = [
    "FINISHES",
    "CyclesRenderer",
    "Finish",
    "TracedPicture",
]
