"""The explained scene: latents, shape model, light, camera, object class."""

from vig.scene.camera import IMAGE_SIZE as IMAGE_SIZE
from vig.scene.camera import Camera as Camera
from vig.scene.camera import angle_difference as angle_difference
from vig.scene.camera import camera_rotation as camera_rotation
from vig.scene.latents import SHAPE_LIMIT as SHAPE_LIMIT
from vig.scene.latents import Block as Block
from vig.scene.latents import LatentLayout as LatentLayout
from vig.scene.latents import Latents as Latents
from vig.scene.latents import latent_layout as latent_layout
from vig.scene.latents import layout_of_width as layout_of_width
from vig.scene.latents import point_layout as point_layout
from vig.scene.latents import regressed_layout as regressed_layout
from vig.scene.light import EXPOSURE_L00 as EXPOSURE_L00
from vig.scene.light import irradiance as irradiance
from vig.scene.light import linear_from_srgb as linear_from_srgb
from vig.scene.light import rotate_z as rotate_z
from vig.scene.light import rotations_z as rotations_z
from vig.scene.light import sh_basis as sh_basis
from vig.scene.light import srgb8_from_linear as srgb8_from_linear
from vig.scene.light import srgb_from_linear as srgb_from_linear
from vig.scene.object_class import Family as Family
from vig.scene.object_class import ObjectClass as ObjectClass
from vig.scene.shape_model import ShapeModel as ShapeModel
from vig.scene.symmetry import Symmetry as Symmetry
