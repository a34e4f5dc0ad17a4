"""The path-traced tier: the scenes of `vig.synthesis` by Blender's Cycles, in processes of its own."""

from vig.synthesis.cycles.appearance import FINISHES, Finish
from vig.synthesis.cycles.renderer import CyclesRenderer, TracedPicture

__all__ = ["FINISHES", "CyclesRenderer", "Finish", "TracedPicture"]
