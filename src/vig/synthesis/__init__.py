"""Stochastic worlds: object designs, rooms, props, textures and light, from (seed, index)."""

from vig.synthesis.build import Instance, build, export
from vig.synthesis.panoramas import grey_light, panorama
from vig.synthesis.picture import Picture
from vig.synthesis.props import FAMILIES, Material, Prop
from vig.synthesis.raster import render
from vig.synthesis.sampling import sample
from vig.synthesis.spec import SPLITS, Placed, Room, SceneSpec, Split, Surface
from vig.synthesis.textures import texture

__all__ = [
    "FAMILIES",
    "SPLITS",
    "Instance",
    "Material",
    "Picture",
    "Placed",
    "Prop",
    "Room",
    "SceneSpec",
    "Split",
    "Surface",
    "build",
    "export",
    "grey_light",
    "panorama",
    "render",
    "sample",
    "texture",
]
