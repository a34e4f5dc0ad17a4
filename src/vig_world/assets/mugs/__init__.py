"""Procedural designs of mugs and cups in dense correspondence."""

from vig_world.assets.mugs.design import HELD_OUT_MUGS, TRAINING_MUGS, VALIDATION_MUGS, MugDesign
from vig_world.assets.mugs.drawn import draw_mug, drawn_mugs
from vig_world.assets.mugs.flaws import flaws
from vig_world.assets.mugs.mug import MUG_FACES, MUG_MIRROR, MUG_PARTS, PART_NAMES, mug_vertices

__all__ = [
    "HELD_OUT_MUGS",
    "MUG_FACES",
    "MUG_MIRROR",
    "MUG_PARTS",
    "PART_NAMES",
    "TRAINING_MUGS",
    "VALIDATION_MUGS",
    "MugDesign",
    "draw_mug",
    "drawn_mugs",
    "flaws",
    "mug_vertices",
]
