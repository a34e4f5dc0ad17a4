"""Readers of mesh files, each format's pitfalls in a file of its own."""

from vig_world.assets.own.meshes.gltf import read_gltf
from vig_world.assets.own.meshes.obj import plain_obj, read_obj
from vig_world.assets.own.meshes.off import read_off
from vig_world.assets.own.meshes.ply import read_ply
from vig_world.assets.own.meshes.stl import count_stl, read_stl

__all__ = ["count_stl", "plain_obj", "read_gltf", "read_obj", "read_off", "read_ply", "read_stl"]
