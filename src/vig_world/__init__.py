"""Stochastic worlds: object designs, furnished rooms, props, textures and light, from (seed, index)."""

from vig_world.assets.panoramas.light import grey_light, local_light
from vig_world.assets.panoramas.painting import panorama
from vig_world.assets.props import FAMILIES
from vig_world.assets.props.material import Material, Prop
from vig_world.assets.target import target_vertices
from vig_world.assets.textures import texture
from vig_world.composition.sampling import sample
from vig_world.library import Library, OwnAssets
from vig_world.renderers.build import Instance, build
from vig_world.renderers.picture import Picture
from vig_world.renderers.rasterized import render

__all__ = [
    "FAMILIES",
    "Instance",
    "Library",
    "Material",
    "OwnAssets",
    "Picture",
    "Prop",
    "build",
    "grey_light",
    "local_light",
    "panorama",
    "render",
    "sample",
    "target_vertices",
    "texture",
]
