"""The path-traced renderer: scenes by Blender's Cycles, in separate processes."""

from vig_world.renderers.cycles.renderer import CyclesRenderer as CyclesRenderer
from vig_world.renderers.cycles.renderer import TracedPicture as TracedPicture
