"""A class pack from a folder of meshes."""

from vig_train.building.build import build_class
from vig_train.building.result import BuildResult
from vig_train.building.settings import BuildSettings

__all__ = ["BuildResult", "BuildSettings", "build_class"]
