"""Explained objects as binary glTF files (GLB), with a texture from the photo."""

from vig_app.glb.bake import Texture, bake
from vig_app.glb.files import LOOKS_BACK, write_object, write_scene

__all__ = ["LOOKS_BACK", "Texture", "bake", "write_object", "write_scene"]
