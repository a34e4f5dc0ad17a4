"""Procedural furnished rooms, each a pure function of a random generator."""

from vig_world.rooms.draw import draw_layout
from vig_world.rooms.layout import Layout, material_under

__all__ = [
    "Layout",
    "draw_layout",
    "material_under",
]
