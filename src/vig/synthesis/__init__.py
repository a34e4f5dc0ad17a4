"""Stochastic worlds: object designs, furnished rooms, props, textures and light, from (seed, index)."""

from vig.synthesis.build import Instance, build
from vig.synthesis.library import Library, OwnAssets
from vig.synthesis.panoramas import grey_light, local_light, panorama
from vig.synthesis.picture import Picture
from vig.synthesis.props import FAMILIES, Material, Prop
from vig.synthesis.rendering import render
from vig.synthesis.sampling import sample
from vig.synthesis.spec import SPLITS, WORLD_VERSION, Placed, Room, SceneSpec, Split, Surface
from vig.synthesis.target import target_vertices
from vig.synthesis.textures import texture

__all__ = [
    "FAMILIES",
    "SPLITS",
    "WORLD_VERSION",
    "Instance",
    "Library",
    "Material",
    "OwnAssets",
    "Picture",
    "Placed",
    "Prop",
    "Room",
    "SceneSpec",
    "Split",
    "Surface",
    "build",
    "grey_light",
    "local_light",
    "panorama",
    "render",
    "sample",
    "target_vertices",
    "texture",
]
