"""Procedural furnished rooms, each a pure function of a random generator."""

from vig_world.rooms.draw import draw_layout
from vig_world.rooms.layout import Layout, material_under
from vig_world.rooms.unfurnished import EMPTY, SPACE, draw_hall, draw_sweep

__all__ = [
    "EMPTY",
    "SPACE",
    "Layout",
    "draw_hall",
    "draw_layout",
    "draw_sweep",
    "material_under",
]
