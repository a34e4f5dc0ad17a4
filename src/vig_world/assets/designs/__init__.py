"""Procedural teapot designs in dense correspondence."""

from vig_world.assets.designs.design import (
    HELD_OUT_DESIGNS,
    TRAINING_DESIGNS,
    VALIDATION_DESIGNS,
    TeapotDesign,
)
from vig_world.assets.designs.teapot import MIRROR, PART_NAMES, TEAPOT_FACES, TEAPOT_PARTS, teapot_vertices

__all__ = [
    "HELD_OUT_DESIGNS",
    "MIRROR",
    "PART_NAMES",
    "TEAPOT_FACES",
    "TEAPOT_PARTS",
    "TRAINING_DESIGNS",
    "VALIDATION_DESIGNS",
    "TeapotDesign",
    "teapot_vertices",
]
