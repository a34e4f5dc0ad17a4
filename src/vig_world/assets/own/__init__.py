"""Custom panoramas, props and furniture, read from folders of HDR and mesh files."""

from vig_world.assets.own.envmaps import OwnPanorama, bpy_panoramas, read_envmaps
from vig_world.assets.own.furniture import OwnFurniture, read_furniture
from vig_world.assets.own.props import OwnProp, read_props

__all__ = [
    "OwnFurniture",
    "OwnPanorama",
    "OwnProp",
    "bpy_panoramas",
    "read_envmaps",
    "read_furniture",
    "read_props",
]
