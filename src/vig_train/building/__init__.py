"""A class pack from a folder of meshes."""

from vig_train.building.build import build_class as build_class
from vig_train.building.result import BuildResult as BuildResult
from vig_train.building.settings import BuildSettings as BuildSettings
