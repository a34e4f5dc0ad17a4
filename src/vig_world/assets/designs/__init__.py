"""Procedural teapot designs in dense correspondence."""

from vig_world.assets.designs.design import (
    HANDLES,
    HELD_OUT_DESIGNS,
    TRAINING_DESIGNS,
    VALIDATION_DESIGNS,
    Handle,
    TeapotDesign,
)
from vig_world.assets.designs.drawn import draw_design, drawn_designs
from vig_world.assets.designs.flaws import flaws
from vig_world.assets.designs.teapot import MIRROR, PART_NAMES, TEAPOT_FACES, TEAPOT_PARTS, teapot_vertices

__all__ = [
    "HANDLES",
    "HELD_OUT_DESIGNS",
    "MIRROR",
    "PART_NAMES",
    "TEAPOT_FACES",
    "TEAPOT_PARTS",
    "TRAINING_DESIGNS",
    "VALIDATION_DESIGNS",
    "Handle",
    "TeapotDesign",
    "draw_design",
    "drawn_designs",
    "flaws",
    "teapot_vertices",
]
