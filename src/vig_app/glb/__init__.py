"""Explained objects as binary glTF files (GLB), with a texture from the photo."""

from vig_app.glb.bake import Texture as Texture
from vig_app.glb.bake import bake as bake
from vig_app.glb.files import LOOKS_BACK as LOOKS_BACK
from vig_app.glb.files import write_object as write_object
from vig_app.glb.files import write_scene as write_scene
