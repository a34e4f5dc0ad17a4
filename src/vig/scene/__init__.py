"""The explained scene: latents, shape model, light, camera, object class."""

from vig.scene.camera import IMAGE_SIZE, Camera, angle_difference, camera_rotation
from vig.scene.latents import (
    SHAPE_LIMIT,
    Block,
    LatentLayout,
    Latents,
    latent_layout,
    layout_of_width,
    point_layout,
    regressed_layout,
)
from vig.scene.light import (
    EXPOSURE_L00,
    irradiance,
    linear_from_srgb,
    rotate_z,
    rotations_z,
    sh_basis,
    srgb8_from_linear,
    srgb_from_linear,
)
from vig.scene.object_class import Family, ObjectClass
from vig.scene.shape_model import ShapeModel
from vig.scene.symmetry import Symmetry

__all__ = [
    "EXPOSURE_L00",
    "IMAGE_SIZE",
    "SHAPE_LIMIT",
    "Block",
    "Camera",
    "Family",
    "LatentLayout",
    "Latents",
    "ObjectClass",
    "ShapeModel",
    "Symmetry",
    "angle_difference",
    "camera_rotation",
    "irradiance",
    "latent_layout",
    "layout_of_width",
    "linear_from_srgb",
    "point_layout",
    "regressed_layout",
    "rotate_z",
    "rotations_z",
    "sh_basis",
    "srgb8_from_linear",
    "srgb_from_linear",
]
