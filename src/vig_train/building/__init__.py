"""A class pack from a folder of meshes."""

from vig_train.building.build import Builder, BuildSettings, Built

__all__ = ["BuildSettings", "Builder", "Built"]
