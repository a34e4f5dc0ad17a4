"""Procedural teapot designs in dense correspondence."""

from vig.synthesis.designs.catalogue import TRAINING_DESIGNS
from vig.synthesis.designs.design import TeapotDesign
from vig.synthesis.designs.further import HELD_OUT_DESIGNS, VALIDATION_DESIGNS
from vig.synthesis.designs.teapot import MIRROR, PART_NAMES, TEAPOT_FACES, TEAPOT_PARTS, teapot_vertices

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
