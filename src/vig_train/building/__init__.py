"""A class pack from a folder of meshes."""

from vig_train.building.build import Builder, BuildResult, BuildSettings

__all__ = ["BuildResult", "BuildSettings", "Builder"]
