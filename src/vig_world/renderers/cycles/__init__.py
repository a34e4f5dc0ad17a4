"""The path-traced renderer: scenes by Blender's Cycles, in separate processes."""

from vig_world.renderers.cycles.renderer import CyclesRenderer, TracedPicture

__all__ = ["CyclesRenderer", "TracedPicture"]
