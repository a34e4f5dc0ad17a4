"""Custom panoramas, props and furniture, read from folders of HDR and mesh files."""

from vig_world.assets.own.envmaps import OwnPanorama, bpy_panoramas, read_envmaps
from vig_world.assets.own.furniture import read_furniture
from vig_world.assets.own.props import read_props

__all__ = [
    "OwnPanorama",
    "bpy_panoramas",
    "read_envmaps",
    "read_furniture",
    "read_props",
]
