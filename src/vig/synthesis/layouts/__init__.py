"""Procedural furnished rooms, each a pure function of a random generator."""

from vig.synthesis.layouts.draw import draw_layout
from vig.synthesis.layouts.ground import material_under
from vig.synthesis.layouts.layout import Layout

__all__ = ["Layout", "draw_layout", "material_under"]
