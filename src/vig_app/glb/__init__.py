"""Explained objects as binary glTF files (GLB), with a texture from the photo."""

from vig_app.glb.bake import Texture, bake
from vig_app.glb.files import write_object, write_scene
from vig_app.glb.write import LOOKS_BACK, GlbObject, write_glb

__all__ = [
    "LOOKS_BACK",
    "GlbObject",
    "Texture",
    "bake",
    "write_glb",
    "write_object",
    "write_scene",
]
